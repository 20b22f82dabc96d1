"""`relnav stars attitude`: star frames of a flight become the camera attitude that `relnav filter` reads."""

import csv

import numpy as np
import pytest

import relnav
from relnav.geometry.orbital_attitude import dcm_lvlh_from_inertial
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

EARTH = (-10.2, 25.3, 11.0)
RADIUS_KM, RATE = 6778.137, 0.0011313666536110223
OPTIONS = ("--model", "dual_field_star", "--earth-velocity-km-s", *EARTH)


def orbit_state(t):
    """A circular orbit in a plane of its own."""
    u, w = np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.0, 1.0])
    c, s = np.cos(RATE * t), np.sin(RATE * t)
    return RADIUS_KM * (c * u + s * w), RADIUS_KM * RATE * (c * w - s * u)


@pytest.fixture
def flight(tmp_path):
    """Star frames every 4 s while the camera holds its attitude of the model, the orbit, and which spots are stars."""
    sensor, mission = relnav.load_model("dual_field_star"), relnav.load_model("three_beacon_psd")
    simulator, rng = StarFieldSimulator(sensor, SkyConditions()), np.random.default_rng(1)
    with (tmp_path / "frames.csv").open("w", newline="") as file, (tmp_path / "true.txt").open("w") as true:
        writer = csv.writer(file)
        writer.writerow(["t_s", "x_px", "y_px", "magnitude"])
        for t in range(0, 21, 4):
            r, v = orbit_state(t)
            dcm = mission.dcm_cam_from_lvlh @ dcm_lvlh_from_inertial(r, v)
            frame = simulator.frame(rng, velocity_km_s=np.array(EARTH) + v, dcm=dcm)
            writer.writerows([t, *spot, m] for spot, m in zip(frame.spots_px, frame.magnitude, strict=True))
            true.writelines(f"{int(star > 0)}\n" for star in frame.hip)
    with (tmp_path / "orbit.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t_s", "x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s"])
        writer.writerows([t, *np.concatenate(orbit_state(t))] for t in (-10.0, 0.0, 15.0, 30.0))
    return tmp_path


def test_it_feeds_the_navigation_filter(run, flight, short_log):
    """The attitude is the model's to arcseconds, and the filter's track with it is the one without."""
    code, out, err = run(
        *("stars", "attitude", flight / "frames.csv", "--orbit", flight / "orbit.csv", *OPTIONS),
        *("--out", flight / "attitude.csv", "--log", short_log, "--joined", flight / "joined.csv"),
    )
    assert (code, err) == (0, "")
    assert "(6 of 6 frames)" in out
    held = np.array(relnav.load_model("three_beacon_psd").attitude.q_cam_from_lvlh)
    with (flight / "attitude.csv").open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    for row in rows:
        q = np.array([float(row[f"q_cam_from_lvlh_{axis}"]) for axis in "xyzw"])
        assert 2.0 * np.linalg.norm(q - held * np.sign(q @ held)) < 1e-4
        assert float(row["sigma_attitude_z_arcsec"]) < 8.0
    model = relnav.load_model("three_beacon_psd")
    with_it = relnav.filter_log(flight / "joined.csv", model, method="spots")
    without = relnav.filter_log(short_log, model, method="spots")
    assert len(with_it) == len(without) == 200
    assert np.nanmax(np.abs(with_it.state - without.state)) < 1e-3
    assert np.array_equal(np.isfinite(with_it.state), np.isfinite(without.state))


WRONG = {
    "no Earth": (["--model", "dual_field_star"], 2, "two fields need --earth-velocity-km-s"),
    "too fast": (
        ["--model", "dual_field_star", "--earth-velocity-km-s", 3e4, 0, 0],
        2,
        "--earth-velocity-km-s: velocity_km_s is in km/s and up to 300",
    ),
    "log alone": ([*OPTIONS, "--log", "log.csv"], 2, "--log and --joined go together"),
    "log without orbit": (
        ["--model", "ground_camera", "--track", "--log", "log.csv", "--joined", "j.csv"],
        2,
        "--log needs --orbit",
    ),
    "mounting": ([*OPTIONS, "--q-cam-from-star", 1, 1, 0, 0], 2, "--q-cam-from-star: a rotation quaternion"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong(run, flight, monkeypatch, name):
    monkeypatch.chdir(flight)
    (flight / "log.csv").write_text("t_s\n0\n")
    options, expected, text = WRONG[name]
    orbit = [] if name == "log without orbit" else ["--orbit", "orbit.csv"]
    code, out, err = run("stars", "attitude", "frames.csv", *orbit, *options, "--out", "a.csv")
    assert code == expected
    assert text in err
    assert out == ""
    assert not (flight / "a.csv").exists()


def test_no_frame_has_an_attitude(run, flight):
    """Two stars of each frame are left: nothing is written, and the sentence says where to look."""
    head, *rows = (flight / "frames.csv").read_text().splitlines()
    times = [row.split(",")[0] for row in rows]
    few = [row for k, row in enumerate(rows) if times[:k].count(times[k]) < 2]
    (flight / "frames.csv").write_text("\n".join([head, *few]) + "\n")
    code, out, err = run(
        "stars", "attitude", flight / "frames.csv", "--orbit", flight / "orbit.csv", *OPTIONS, "--out", flight / "a.csv"
    )
    assert (code, out) == (3, "")
    assert "frames.csv: no frame of 6 has a credible attitude; `relnav stars solve` tells why" in err
    assert not (flight / "a.csv").exists()


def test_an_orbit_that_is_too_short(run, flight):
    (flight / "orbit.csv").write_text(
        "t_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n0,7000,0,0,0,7.5,0\n5,7000,37,0,0,7.5,0\n"
    )
    code, _, err = run(
        "stars", "attitude", flight / "frames.csv", "--orbit", flight / "orbit.csv", *OPTIONS, "--out", flight / "a.csv"
    )
    assert code == 3
    assert "covers 0 to 5 s; a frame was taken at 8 s" in err


def test_a_log_outside_the_star_frames(run, flight, vbar_log):
    code, _, err = run(
        *("stars", "attitude", flight / "frames.csv", "--orbit", flight / "orbit.csv", *OPTIONS),
        *("--out", flight / "a.csv", "--log", vbar_log, "--joined", flight / "b.csv"),
    )
    assert code == 3
    assert "lies outside the star sensor's attitudes" in err
    assert not (flight / "a.csv").exists()
    assert not (flight / "b.csv").exists()


BAD_LOGS = {
    "Latin-1": ("# caf\u00e9\nt_s\n1\n2\n".encode("latin-1"), "not a text file in UTF-8"),
    "no time": (b"t_s,note\n1,0\nnan,0\n", "log.csv:3: column 't_s' is empty or NaN; only a spot may be missing"),
    "no time at first": (b"t_s,note\n,0\n2,0\n", "log.csv:2: column 't_s' is empty or NaN"),
    "no end of time": (b"t_ms,note\n1,0\ninf,0\n", "log.csv:3: column 't_ms' is infinite; only a spot may be missing"),
    "backward": (b"t_s,note\n2,0\n1,0\n", "log.csv:3: time 1 s is not after 2 s of the row before"),
    "late": (b"t_s,note\n1,0\n4000,0\n", "log.csv:3: time 4000 s lies outside the star sensor's attitudes"),
}


@pytest.mark.parametrize("name", BAD_LOGS)
def test_a_bad_log_leaves_nothing_behind(run, flight, name):
    """Neither the joined log nor the attitudes that had been solved."""
    content, text = BAD_LOGS[name]
    (flight / "log.csv").write_bytes(content)
    before = sorted(flight.iterdir())
    code, out, err = run(
        *("stars", "attitude", flight / "frames.csv", "--orbit", flight / "orbit.csv", *OPTIONS),
        *("--out", flight / "a.csv", "--log", flight / "log.csv", "--joined", flight / "b.csv"),
    )
    assert (code, out) == (3, "")
    assert text in err
    assert sorted(flight.iterdir()) == before


def test_a_log_with_a_byte_order_mark(run, flight):
    (flight / "log.csv").write_bytes(b"\xef\xbb\xbft_s,note\n1,0\n2,0\n")
    code, _, err = run(
        *("stars", "attitude", flight / "frames.csv", "--orbit", flight / "orbit.csv", *OPTIONS),
        *("--out", flight / "a.csv", "--log", flight / "log.csv", "--joined", flight / "b.csv"),
    )
    assert (code, err) == (0, "")
    assert (flight / "b.csv").read_text().startswith("t_s,note,q_cam_from_lvlh_x")


def test_frames_of_three_stars_are_tracked(run, flight):
    """Of the third and fourth frame three bright stars are left: lost without --track, found with it."""
    lines = (flight / "frames.csv").read_text().splitlines()
    few, count = [lines[0]], {}
    for line, true in zip(lines[1:], (flight / "true.txt").read_text().split(), strict=True):
        t = line.split(",")[0]
        count[t] = count.get(t, 0) + int(true)
        if t not in ("8", "12") or (count[t] <= 3 and true == "1"):
            few.append(line)
    (flight / "few.csv").write_text("\n".join(few) + "\n")
    command = ["stars", "attitude", flight / "few.csv", "--orbit", flight / "orbit.csv", *OPTIONS, "--out"]
    code, out, _ = run(*command, flight / "lost.csv")
    assert code == 0
    assert "(4 of 6 frames)" in out
    code, out, _ = run(*command, flight / "tracked.csv", "--track")
    assert code == 0
    assert "(6 of 6 frames, 2 of them tracked)" in out
    held = np.array(relnav.load_model("three_beacon_psd").attitude.q_cam_from_lvlh)
    with (flight / "tracked.csv").open() as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            q = np.array([float(row[f"q_cam_from_lvlh_{axis}"]) for axis in "xyzw"])
            off = 206265.0 * 2.0 * np.linalg.norm(q - held * np.sign(q @ held))
            sigma = [float(row[f"sigma_attitude_{axis}_arcsec"]) for axis in "xyz"]
            assert off < 5.0 * max(sigma)


def test_without_an_orbit_attitudes_are_inertial(run, flight):
    """The same frames, q_cam_from_icrs: with the orbit's frame between them they are those of the other table."""
    options = [flight / "frames.csv", *OPTIONS, "--track", "--out"]
    assert run("stars", "attitude", *options, flight / "icrs.csv")[0] == 0
    assert run("stars", "attitude", *options, flight / "lvlh.csv", "--orbit", flight / "orbit.csv")[0] == 0
    text = (flight / "icrs.csv").read_text()
    assert "q_cam_from_icrs_w" in text
    assert "v_cam = R v_icrs" in text
    tables = []
    for name in ("icrs.csv", "lvlh.csv"):
        lines = [line for line in (flight / name).read_text().splitlines() if not line.startswith("#")]
        tables.append([dict(zip(lines[0].split(","), map(float, x.split(",")), strict=True)) for x in lines[1:]])
    assert len(tables[0]) == len(tables[1])
    for inertial, orbital in zip(*tables, strict=True):
        own = dcm_from_quaternion(np.array([inertial[f"q_cam_from_icrs_{part}"] for part in "xyzw"]))
        other = dcm_from_quaternion(np.array([orbital[f"q_cam_from_lvlh_{part}"] for part in "xyzw"]))
        r, v = orbit_state(inertial["t_s"])
        np.testing.assert_allclose(own, other @ dcm_lvlh_from_inertial(r, v), atol=3e-5)  # 7.7 km/s of aberration
    code, _, err = run("stars", "attitude", *options, flight / "a.csv", "--log", "l.csv", "--joined", "j.csv")
    assert code == 2
    assert "--orbit" in err or "l.csv" in err


def test_each_spots_noise(run, flight):
    """Of a log whose sigmas are a third of the model's, what it leaves being none of it, or all."""
    lines = (flight / "frames.csv").read_text().splitlines()
    noise = relnav.load_model("dual_field_star").camera.spot_noise_px
    rows = [f"{line},{noise / 3.0},{noise / 3.0},0" for line in lines[1:]]
    (flight / "noise.csv").write_text("\n".join([f"{lines[0]},sigma_x_px,sigma_y_px,correlation", *rows]) + "\n")
    sigma = {}
    for name, file, more in (
        ("model", "frames.csv", []),
        ("as stated", "noise.csv", ["--residual-px", noise * np.sqrt(8.0 / 9.0)]),
        ("wider", "noise.csv", ["--residual-px", 2.0 * noise]),
    ):
        out = flight / "out.csv"
        assert run("stars", "attitude", flight / file, *OPTIONS, *more, "--track", "--out", out)[0] == 0
        lines = [line for line in out.read_text().splitlines() if not line.startswith("#")]
        sigma[name] = np.array([line.split(",")[-3:] for line in lines[1:]], dtype=float)
    np.testing.assert_allclose(sigma["as stated"], sigma["model"], rtol=0.02)
    ratio = np.sqrt(37.0 / 9.0)
    np.testing.assert_allclose(sigma["wider"][:, 0], ratio * sigma["model"][:, 0], rtol=0.02)  # y, z: the mirror's too


def test_a_log_is_not_one_frame(run, flight):
    code, _, err = run("stars", "solve", flight / "frames.csv", "--focal-px", "4000")
    assert code == 3
    assert "a log of frames, of which `relnav stars attitude` makes attitudes" in err
