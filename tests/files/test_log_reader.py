"""What a log may look like and still be read: empty cells, metadata, CRLF, BOM, quotes, blank lines, other columns."""

import numpy as np
import pytest

import relnav
from relnav.files.filter_log import filter_log
from relnav.files.logs import read_log

EXPECTED = [[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]]


def check(log, rows=3):
    assert log.t_s.tolist() == [0.5 * k for k in range(rows)]
    np.testing.assert_array_equal(log.spots_m, np.tile(EXPECTED, (rows, 1, 1)))


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("last", [True, False])
@pytest.mark.parametrize("bom", [b"", b"\xef\xbb\xbf"])
def test_line_ends_and_byte_order_mark(write_log, lines, end, last, bom):
    check(read_log(write_log(bom + (end.join(lines) + (end if last else "")).encode())))


def test_blank_lines(write_log, lines):
    check(read_log(write_log("\n\n" + "\n\n  \n".join(lines) + "\n\n")))


def test_spaces_around_cells(write_log, lines):
    check(read_log(write_log("\n".join(line.replace(",", " , ") for line in lines))))


def test_quoted_cells(write_log, lines):
    check(read_log(write_log("\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in lines))))


def test_columns_in_any_order(write_log, lines):
    check(read_log(write_log("\n".join(",".join(reversed(line.split(","))) for line in lines))))


def test_one_row(write_log, lines):
    check(read_log(write_log("\n".join(lines[:2]))), rows=1)


def test_metadata_in_leading_comments(write_log, lines):
    head = "# satellite = Tango\n#epoch=2026-01-01T00:00:00 = TAI\n# a remark\n\n"
    log = read_log(write_log(head + "\n".join(lines)))
    check(log)
    assert log.metadata == {"satellite": "Tango", "epoch": "2026-01-01T00:00:00 = TAI"}


@pytest.mark.parametrize("empty", ["", " ", "nan", "NaN", '""'])
def test_an_empty_spot_is_not_seen(write_log, lines, empty):
    lines[2] = f"0.5,{empty},{empty},1500,0,0,{empty}"
    log = read_log(write_log("\n".join(lines)))
    assert np.argwhere(np.isnan(log.spots_m)).tolist() == [[1, 0, 0], [1, 0, 1], [1, 2, 1]]
    assert np.isnan(log.spots_m[1, 0]).all()
    assert log.spots_m[1, 1].tolist() == [0.0015, 0.0]


def test_rows_of_nothing_but_a_time(write_log, lines):
    log = read_log(write_log("\n".join([*lines, "1.5,,,,,,", "2.0,,,,,,"])))
    assert log.t_s.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert np.isnan(log.spots_m[3:]).all()


@pytest.mark.parametrize("value", ["inf", "-inf", "1e308", "1e999"])
def test_absurd_spots_go_to_the_filter_which_refuses_them(write_log, lines, value):
    rows = [f"{0.1 * k!r},-1500,0,1500,0,0,0" for k in range(5)] + [f"0.5,{value},0,1500,0,0,0"]
    solution = filter_log(write_log("\n".join([lines[0], *rows])), "three_beacon_psd", method="spots")
    assert solution.status.tolist() == [0, 5, 1, 1, 1, 2]
    assert np.isfinite(solution.state[1:]).all()


def test_numbers_of_every_kind(write_log, lines):
    lines[1] = "0,-1.5e3,+0,1500.,.0,-0,1e-5"
    log = read_log(write_log("\n".join(lines)))
    np.testing.assert_allclose(log.spots_m[0], [[-0.0015, 0], [0.0015, 0], [0, 1e-11]], rtol=1e-15)


def test_columns_of_other_matters_are_named_and_left(write_log, lines):
    lines = [line + (",temperature_degC,operator" if k == 0 else ",20.5,smith") for k, line in enumerate(lines)]
    path = write_log("\n".join(lines))
    log = read_log(path)
    check(log)
    assert log.ignored == ("temperature_degC", "operator")
    assert filter_log(path, "three_beacon_psd").metadata["ignored columns"] == "temperature_degC, operator"


def test_control_and_attitude(write_log, lines):
    more = [f"accel_{axis}_m_s2" for axis in "xyz"] + [f"delta_v_{axis}_m_s" for axis in "xyz"]
    more += [f"q_cam_from_lvlh_{axis}" for axis in "xyzw"]
    cells = ["1", "2", "3", "4", "5", "6", "0.5", "-0.5", "-0.5", "-0.5"]
    log = read_log(
        write_log("\n".join([lines[0] + "," + ",".join(more), *(f"{r},{','.join(cells)}" for r in lines[1:])]))
    )
    check(log)
    assert log.acceleration_m_s2.tolist() == [[1, 2, 3]] * 3
    assert log.delta_v_m_s.tolist() == [[4, 5, 6]] * 3
    assert log.q_cam_from_lvlh.tolist() == [[0.5, -0.5, -0.5, -0.5]] * 3


def test_what_is_not_there_is_none(write_log, lines):
    log = read_log(write_log("\n".join(lines)))
    assert log.acceleration_m_s2 is None
    assert log.delta_v_m_s is None
    assert log.q_cam_from_lvlh is None


@pytest.mark.parametrize("quoted", [True, False])
def test_long_logs_are_read_in_chunks_without_a_seam(write_log, lines, quoted):
    """More than twice the chunk of 20000 lines, blank lines in between, read fast and cell by cell."""
    n = 45_000
    cell = '"0"' if quoted else "0"
    rows = [f"{0.25 * k!r},{k % 4000 - 2000},1,1500,{cell},,2" + ("\n" if k % 9999 == 0 else "") for k in range(n)]
    log = read_log(write_log("\n".join([lines[0], *rows])))
    k = np.arange(n)
    np.testing.assert_array_equal(log.t_s, 0.25 * k)
    np.testing.assert_allclose(log.spots_m[:, 0, 0], (k % 4000 - 2000) * 1e-6, rtol=1e-15)
    assert np.isnan(log.spots_m[:, 2, 0]).all()


def test_the_example_log_is_what_numpy_reads(vbar_log):
    log = read_log(vbar_log)
    raw = np.genfromtxt(vbar_log, delimiter=",", skip_header=1)
    np.testing.assert_array_equal(log.t_s, raw[:, 0])
    np.testing.assert_allclose(log.spots_m.reshape(-1, 6), raw[:, 1:7] * 1e-6, rtol=1e-14)
    np.testing.assert_array_equal(log.acceleration_m_s2, raw[:, 7:10])


def test_filter_log_says_where_the_solution_is_from(write_log, lines):
    path = write_log("# pass = 12\n" + "\n".join(lines))
    solution = filter_log(path, relnav.load_model("three_beacon_psd"), method="fix", projection="parallel")
    assert (solution.model, solution.method) == ("three_beacon_psd", "fix")
    assert solution.metadata["log"] == "log.csv"
    assert solution.metadata["log.pass"] == "12"


def test_progress_of_a_log(write_log, lines):
    calls = []
    filter_log(
        write_log("\n".join(lines)),
        "three_beacon_psd",
        progress=lambda done, total: calls.append((done, total)),
        method="spots",
    )
    assert calls == [(3, 3)]
