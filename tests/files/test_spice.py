"""Kernels of SPICE, read by anise and jplephem, which share nothing with NAIF's library, and by that library itself."""

import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
import relnav.cli
from relnav.dynamics.ephemeris import TAI_MINUS_UTC_S, seconds_since_j2000
from relnav.dynamics.two_body import inertial_orbit
from relnav.errors import UsageError
from relnav.files import optional
from relnav.files.spice import tdb_minus_tt

EPOCH = "2026-07-02T12:00:00"
ORIENTATION_DEG = (51.6, 130.0, 40.0)
INERTIAL = {"orientation_deg": ORIENTATION_DEG, "epoch": EPOCH}
EXAMPLE = Path(__file__).parents[2] / "examples" / "basilisk_approach" / "vbar_log.csv"
EARTH, TARGET, CHASER = 399, -9991, -9992
J2000 = 1

spice = pytest.importorskip("spiceypy", reason="spiceypy is not installed")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("spice") / "log.csv"
    path.write_text("".join(EXAMPLE.read_text().splitlines(keepends=True)[:41]))
    return path


@pytest.fixture(scope="module")
def solution(log):
    return relnav.filter_log(log, "three_beacon_psd")


@pytest.fixture
def loaded():
    """What loads kernels into NAIF's library, which forgets them at the end."""
    yield lambda *paths: [spice.furnsh(str(path)) for path in paths]
    spice.kclear()


def et_of(solution):
    zero = seconds_since_j2000(datetime.fromisoformat(EPOCH).replace(tzinfo=UTC))
    return zero + solution.t_s + tdb_minus_tt(zero + solution.t_s)


def target_orbit(mission, t_s):
    orbit = mission.orbit
    shape = orbit.mean_motion_rad_s, orbit.eccentricity, orbit.true_anomaly_rad
    return inertial_orbit(*shape, tuple(np.radians(ORIENTATION_DEG)), t_s)


def eci_from_lvlh(mission, t_s):
    r, v = target_orbit(mission, t_s)
    h = np.cross(r, v)
    y, z = -h / np.linalg.norm(h, axis=1)[:, None], -r / np.linalg.norm(r, axis=1)[:, None]
    return np.stack([np.cross(y, z), y, z], axis=2)


def by_anise(almanac, of, about, et):
    anise = pytest.importorskip("anise", reason="anise is not installed")
    epoch = anise.time.Epoch.from_et_seconds(float(et))
    state = almanac.translate(anise.astro.Frame(of, J2000), anise.astro.Frame(about, J2000), epoch, None)
    return 1e3 * np.array([state.x_km, state.y_km, state.z_km, state.vx_km_s, state.vy_km_s, state.vz_km_s])


@pytest.mark.parametrize("frame", ["lvlh_ccsds", "eci_relative", "eci"])
def test_spk_by_anise(solution, tmp_path, frame, outside):
    anise = pytest.importorskip("anise", reason="anise is not installed")
    relnav.write(solution, tmp_path / "track.bsp", frame=frame, **INERTIAL)
    almanac = anise.Almanac(str(tmp_path / "track.bsp"))
    known = np.flatnonzero(np.isfinite(solution.state[:, 0]))
    relative = solution.in_frame("eci_relative", orientation_deg=ORIENTATION_DEG).state
    inertial = solution.in_frame("eci", orientation_deg=ORIENTATION_DEG).state
    et = et_of(solution)
    half_s = 0.5 * (et[known[:-1]] + et[known[1:]])
    rounded_m = 7.7e3 * 2 * 1.2e-7  # two units of TDB's last place, at orbital speed
    between = 0.5 * (solution.t_s[known[:-1]] + solution.t_s[known[1:]])
    target = np.concatenate(target_orbit(relnav.load_model("three_beacon_psd"), between), axis=1)
    off = 0.0
    for e, half, there in zip(known[1:-1], half_s[1:], target[1:], strict=True):
        off = max(off, np.abs(by_anise(almanac, CHASER, TARGET, et[e]) - relative[e]).max())
        line = 0.5 * (relative[e] + relative[e + 1])
        np.testing.assert_allclose(by_anise(almanac, CHASER, TARGET, half), line, rtol=0, atol=1e-6)
        if frame == "eci":
            np.testing.assert_allclose(by_anise(almanac, CHASER, EARTH, et[e]), inertial[e], rtol=0, atol=rounded_m)
            np.testing.assert_allclose(by_anise(almanac, TARGET, EARTH, half), there, rtol=0, atol=rounded_m)
    outside("anise", "SPK read back at the epochs, chaser from target, m and m/s", off, 1e-7)
    if frame != "eci":
        with pytest.raises(Exception, match="399 not present"):
            by_anise(almanac, CHASER, EARTH, half_s[1])


def test_ck_by_jplephem(poses, tmp_path, outside):
    """The container by jplephem, a segment of type 3 by NAIF's description (CK Required Reading)."""
    daf = pytest.importorskip("jplephem.daf", reason="jplephem is not installed")
    relnav.write(poses, tmp_path / "track.bc", **INERTIAL)
    text = (tmp_path / "track.tsc").read_text()
    _, begin, rate = map(float, re.search(r"SCLK01_COEFFICIENTS_9991 += \( (\S+) (\S+) (\S+) \)", text).groups())
    ticks_a_second = int(re.search(r"SCLK01_MODULI_9991 += \( 4294967296 (\d+) \)", text)[1])
    known = np.flatnonzero(np.isfinite(poses.state[:, 0]))
    space = eci_from_lvlh(poses.mission, poses.t_s[known])
    target = space @ poses.dcm_lvlh_from_target[known]
    bodies = {TARGET: target, CHASER: target @ poses.dcm_target_from_chaser[known]}
    with (tmp_path / "track.bc").open("rb") as file:
        kernel = daf.DAF(file)
        assert kernel.locidw == b"DAF/CK"
        assert "bodies: TARGET -9991, CHASER -9992" in kernel.comments()
        segments = list(kernel.summaries())
        assert [values[2] for _, values in segments] == [1000 * TARGET, 1000 * CHASER]
        for _, (first, last, structure, axes, kind, rates, begin_word, end_word) in segments:
            assert (axes, kind, rates) == (J2000, 3, int(structure == 1000 * TARGET))
            words = kernel.read_array(begin_word, end_word)
            intervals, count = map(int, words[-2:])
            assert (intervals, count) == (1, len(known))
            width = 7 if rates else 4
            rows, ticks = words[: width * count].reshape(count, width), words[width * count :][:count]
            np.testing.assert_array_equal([first, last], ticks[[0, -1]])
            np.testing.assert_allclose(begin + ticks * rate / ticks_a_second, et_of(poses)[known], rtol=0, atol=2e-7)
            body_from_eci = np.swapaxes(bodies[structure // 1000], 1, 2)
            turns = Rotation.from_quat(rows[:, [1, 2, 3, 0]]).as_matrix()
            outside("jplephem", "CK read back, matrix elements", np.abs(turns - body_from_eci).max(), 1e-12)
            if rates:
                np.testing.assert_allclose(
                    np.einsum("nij,nj->ni", body_from_eci, rows[:, 4:]), poses.rate_rad_s[known], atol=1e-15
                )


def test_attitudes_by_naifs_own_reader(poses, tmp_path, loaded, outside):
    moved = replace(poses, epochs=poses.epochs.copy())
    moved.epochs["t"] -= 1.25  # a clock has no time before its zero
    relnav.write(moved, tmp_path / "track.bc", **INERTIAL)
    loaded(tmp_path / "track.tsc", tmp_path / "track.bc")
    known = np.flatnonzero(np.isfinite(moved.state[:, 0]))
    space = eci_from_lvlh(moved.mission, moved.t_s[known])
    off = 0.0
    for e, lvlh, et in zip(known, space, et_of(moved)[known], strict=True):
        target_from_eci = (lvlh @ moved.dcm_lvlh_from_target[e]).T
        off = max(off, np.abs(spice.pxform("J2000", "TARGET_BODY", et) - target_from_eci).max())
        relative = spice.pxform("CHASER_BODY", "TARGET_BODY", et)
        off = max(off, np.abs(relative - moved.dcm_target_from_chaser[e]).max())
        _, rate, _ = spice.ckgpav(1000 * TARGET, spice.sce2c(TARGET, et), 0, "J2000")
        np.testing.assert_allclose(target_from_eci @ rate, moved.rate_rad_s[e], atol=1e-12)
    outside("SPICE (NAIF, spiceypy)", "CK read back through its clock, matrix elements", off, 1e-9)
    assert spice.bodn2c("CHASER") == CHASER


def test_a_straight_line_misses_the_arc_by_an_eighth_of_the_turn_squared(solution, tmp_path, loaded):
    """The figure of the documentation, for a chaser at rest in the turning frame: r (n h)^2 / 8."""
    resting = np.zeros((40, 6))
    resting[:, 0] = 100.0
    for step_s in (1.0, 10.0):
        whole = replace(solution, t_s=step_s * np.arange(40.0), state=resting)
        path = tmp_path / f"{step_s:g}.bsp"
        relnav.write(whole, path, **INERTIAL)
        loaded(path)
        halfway = replace(whole, t_s=whole.t_s + 0.5 * step_s)
        truth = halfway.in_frame("eci_relative", orientation_deg=ORIENTATION_DEG).state[7, :3]
        state, _ = spice.spkezr(str(CHASER), et_of(halfway)[7], "J2000", "NONE", str(TARGET))
        turn = relnav.load_model("three_beacon_psd").orbit.mean_motion_rad_s * step_s
        assert np.linalg.norm(1e3 * state[:3] - truth) == pytest.approx(100.0 * turn**2 / 8.0, rel=0.02)
        assert turn**2 / 8.0 <= 1.6e-7 * step_s**2


def with_gaps(states):
    """No state in the first two epochs, and twice again."""
    states[[0, 1, 10, 12, 13]] = np.nan
    return states


def test_a_time_without_state_is_not_covered(solution, poses, tmp_path, loaded):
    relnav.write(replace(solution, state=with_gaps(solution.state.copy())), tmp_path / "track.bsp", **INERTIAL)
    holed = replace(poses, epochs=poses.epochs.copy())
    holed.epochs["motion"][3] = np.nan
    relnav.write(holed, tmp_path / "track.bc", **INERTIAL)
    loaded(tmp_path / "track.tsc", tmp_path / "track.bc", tmp_path / "track.bsp")
    et = et_of(solution)
    covered = spice.spkcov(str(tmp_path / "track.bsp"), CHASER)
    spans = [spice.wnfetd(covered, k) for k in range(spice.wncard(covered))]
    assert spans == [(et[2], et[9]), (et[14], et[-1])]  # the state of epoch 11 stands alone
    with pytest.raises(spice.NotFoundError):
        spice.ckgp(1000 * TARGET, spice.sce2c(TARGET, et_of(poses)[3] + 0.1), 0, "J2000")
    spice.ckgp(1000 * TARGET, spice.sce2c(TARGET, et_of(poses)[4] + 0.1), 0, "J2000")


def test_tdb_is_what_naifs_leap_second_kernel_makes_of_utc(tmp_path, loaded):
    """The constants of naif0012.tls, the newest of NAIF's leap second kernels; and pyerfa's series of 787 terms."""
    erfa = pytest.importorskip("erfa", reason="pyerfa is not installed")
    steps = " ".join(f"{seconds:.0f} @{since:%Y-%b-%d}" for since, seconds in TAI_MINUS_UTC_S)
    constants = (
        "DELTET/DELTA_T_A = 32.184\nDELTET/K = 1.657D-3\nDELTET/EB = 1.671D-2\nDELTET/M = ( 6.239996D0 1.99096871D-7 )"
    )
    kernel = tmp_path / "leap.tls"
    kernel.write_text(f"KPL/LSK\n\\begindata\n{constants}\nDELTET/DELTA_AT = ( {steps} )\n\\begintext\n")
    loaded(kernel)
    for text in ("1999-01-01T00:00:00", "2016-12-31T23:59:59", "2017-01-01T00:00:00", "2026-07-02T12:00:00.25"):
        tt = seconds_since_j2000(datetime.fromisoformat(text).replace(tzinfo=UTC))
        assert tt + tdb_minus_tt(tt) == pytest.approx(spice.str2et(text), abs=3e-7)
    days = np.arange(0.0, 15000.0, 7.3)
    series = np.array([erfa.dtdb(2451545.0, day, 0.0, 0.0, 0.0, 0.0) for day in days])
    np.testing.assert_allclose(tdb_minus_tt(86400.0 * days), series, rtol=0, atol=50e-6)


def test_by_the_command(log, solution, marker_log, poses, tmp_path, capsys):
    orbit = ["--orbit-deg", *map(str, ORIENTATION_DEG), "--epoch", EPOCH]
    command = [
        "filter",
        str(log),
        "--model",
        "three_beacon_psd",
        "--out",
        str(tmp_path / "track.bsp"),
        "--frame",
        "eci",
    ]
    assert relnav.cli.run([*command, *orbit, "--quiet"]) == 0
    relnav.write(solution, tmp_path / "same.bsp", frame="eci", **INERTIAL)
    assert (tmp_path / "track.bsp").read_bytes() == (tmp_path / "same.bsp").read_bytes()
    command = ["filter", str(marker_log), "--model", "three_marker_vision", "--out", str(tmp_path / "track.bc")]
    assert relnav.cli.run([*command, *orbit]) == 0
    assert f"clock: {tmp_path / 'track.tsc'}" in capsys.readouterr().out
    relnav.write(poses, tmp_path / "same.bc", **INERTIAL)
    for ending in ("bc", "tsc"):
        assert (tmp_path / f"track.{ending}").read_bytes() == (tmp_path / f"same.{ending}").read_bytes()
    named = [*command, *orbit, "--json", str(tmp_path / "track.tsc")]
    assert relnav.cli.run(named) == 2
    assert "is named twice" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "keywords", "said"),
    [
        ("a.bsp", {"epoch": EPOCH}, r"an SPK is in inertial axes and needs .*\(--orbit-deg 51.6 130 40\)"),
        ("a.bsp", {"orientation_deg": ORIENTATION_DEG}, "an SPK needs the date of the log's t = 0"),
        ("a.bsp", INERTIAL | {"epoch": "1998-07-02T12:00:00"}, "an SPK: times from 1999-01-01 on can be converted"),
        ("a.bsp", INERTIAL | {"frame": "rsw"}, r"an SPK holds frames eci_relative, eci \(.*\); got 'rsw'"),
        ("a.bsp", INERTIAL | {"orientation_deg": (1.0, 2.0, np.nan)}, "needs the orientation of the target's orbit"),
        (f"{'b' * 200}/{'c' * 100}/a.bsp", INERTIAL, "SPICE takes paths of 255 bytes"),
        ("a.bc", INERTIAL, r"which a three-beacon track does not estimate; write its states, \.bsp"),
    ],
)
def test_what_cannot_be_written_is_said(solution, tmp_path, name, keywords, said):
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    with pytest.raises(UsageError, match=said):
        relnav.write(solution, tmp_path / name, **keywords)
    assert list((tmp_path / name).parent.iterdir()) == []


def test_states_that_cannot_be_told_apart_or_stand_alone(solution, tmp_path):
    with pytest.raises(UsageError, match="less than a microsecond apart"):
        relnav.write(replace(solution, t_s=1e-6 * solution.t_s), tmp_path / "a.bsp", **INERTIAL)
    with pytest.raises(UsageError, match="two states in a row or more"):
        relnav.write(solution.part(0, 2), tmp_path / "a.bsp", **INERTIAL)


def test_the_missing_package_is_named_with_its_line(solution, tmp_path, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(optional, "import_module", missing)
    for ending in ("bsp", "bc"):
        with pytest.raises(UsageError, match=r"A SPICE kernel needs spiceypy: pip install 'relnav\[spice\]'"):
            relnav.write(solution, tmp_path / f"a.{ending}", **INERTIAL)
