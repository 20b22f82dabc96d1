"""How fast one `measure` is, of every sensor, and a step of the marker filter: array in, answer read, beside a peer.

    python benchmarks/measure_speed.py --out measure_speed.json
    python benchmarks/measure_speed.py --cold        (adds the first call of a fresh process without compiled code)

A peer does the same work with what a user has at hand: SciPy's least squares on the crystal's formulas, SciPy's
splines over the same grid, SciPy's labelled image, OpenCV's P3P. Each is asserted to give the same answer first. Thread
CPU time, minimum and median over rounds; only the ratios mean anything on another machine. A peer that is not installed
is left out with a sentence.
"""

import argparse
import importlib.util
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import least_squares

import relnav
from relnav.sensors.aps_sun.calibration import as_built
from relnav.sensors.birefringent_sun.spots import project as crystal_spots
from relnav.sensors.three_marker.camera import project as marker_spots
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator
from relnav.simulation.trajectory import Approach

CALL_S = 0.02
"""A round of one contender takes about this long."""


def unit(v):
    """A vector of length 1."""
    return np.asarray(v) / np.linalg.norm(v)


def round_spots(rows, centres, sigma, rng):
    """Counts of an image of round spots on a background of 20."""
    y, x = np.indices((rows, rows))
    image = np.full((rows, rows), 20.0) + rng.normal(size=(rows, rows))
    for at_x, at_y in centres:
        image += 500.0 * np.exp(-0.5 * ((x - at_x) ** 2 + (y - at_y) ** 2) / sigma**2)
    return np.clip(np.round(image), 0.0, 1023.0)


def least_squares_user(model, spots):
    """Both orders of two spots fitted by SciPy: the crystal's two refracted rays, written out with numpy."""
    sensor = model.sensor
    d, n_o, n_e, c = sensor.crystal_thickness_m, sensor.ordinary_index, sensor.extraordinary_index, sensor.axis
    eps = n_o**2 * np.eye(3) + (n_e**2 - n_o**2) * np.outer(c, c)
    sigma, zero = sensor.spot_noise_px * sensor.pixel_pitch_m, np.array(sensor.zero_spot_px)

    def places(u):
        o = np.append(u, np.sqrt(n_o**2 - u @ u))
        flat = np.append(u, 0.0)
        a, b, g = eps[2, 2], eps[2] @ flat, flat @ eps @ flat - n_o**2 * n_e**2
        ray = eps @ np.append(u, (-b + np.sqrt(b * b - a * g)) / a)
        return np.concatenate([d * o[:2] / o[2], d * ray[:2] / ray[2]])

    best = None
    for order in ([0, 1], [1, 0]):
        seen = ((spots[order] - zero) * sensor.pixel_pitch_m).ravel()
        start = n_o * seen[:2] / np.hypot(np.linalg.norm(seen[:2]), d)
        fit = least_squares(lambda u, seen=seen: (places(u) - seen) / sigma, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        if best is None or fit.cost < best.cost:
            best = fit
    u, P = best.x, np.linalg.inv(best.jac.T @ best.jac)
    z = np.sqrt(1.0 - u @ u)
    D = np.vstack([np.eye(2), -u / z])
    return np.append(u, z), D @ P @ D.T


def spline_user(model):
    """Function of one spot: direction and covariance from SciPy's splines over the calibration's grid."""
    used = as_built(model)
    table, noise = used.form, used.spot_noise_px**2
    splines = [RectBivariateSpline(table.x_px, table.y_px, table.tangents[:, :, axis], s=0.0) for axis in range(2)]

    def measure(spot):
        x, y = spot
        t = np.array([s.ev(x, y) for s in splines])
        slope = np.array([[s.ev(x, y, dx=1), s.ev(x, y, dy=1)] for s in splines])
        s = np.append(t, 1.0) / np.sqrt(1.0 + t @ t)
        D = (s[2] * (np.eye(3) - np.outer(s, s))[:, :2]) @ slope
        return s, noise * D @ D.T

    return measure


def labelled_user(image, bits_sigma):
    """Centre (x, y) of the brightest spot: median of the border, threshold, `ndimage.label`, `center_of_mass`."""
    border = np.concatenate([image[0], image[-1], image[1:-1, 0], image[1:-1, -1]])
    signal = image - np.median(border)
    brightest = np.unravel_index(np.argmax(signal), image.shape)
    cut = max(0.05 * signal[brightest], 2.0 * bits_sigma(np.median(border)))
    parts, _ = ndimage.label(signal > cut)
    y, x = ndimage.center_of_mass(signal - cut, parts, parts[brightest])
    return np.array([x, y])


def sun_sensors(rng):
    """Name -> (call, peer or None, name of the peer) of the two sun sensors."""
    crystal, aps = relnav.load_model("birefringent_sun"), relnav.load_model("aps_sun")
    spots = crystal_spots(crystal.sensor, unit([0.02, 0.01, 1.0])) + 0.1 * rng.normal(size=(2, 2))
    corner = tuple(np.floor(spots.mean(axis=0) - 112.0).tolist())
    two = round_spots(224, spots - corner, 2.0, rng)
    spot = np.array(aps.sensor.zero_spot_px) + np.array([130.2, -72.1])
    one = round_spots(aps.image.window_px, [(11.3, 12.1)], 1.5, rng)
    by_splines, gain = spline_user(aps), aps.image.electrons_per_count

    def quiet(level):
        return np.sqrt(aps.image.read_noise_e**2 + max(level, 0.0) * gain) / gain + 1.0 / np.sqrt(12.0)

    ours, theirs = relnav.birefringent_sun.measure(spots, crystal), least_squares_user(crystal, spots)
    assert np.abs(ours.direction - theirs[0]).max() < 1e-9
    assert np.abs(ours.covariance - theirs[1]).max() < 1e-4 * np.trace(theirs[1])
    ours, theirs = relnav.aps_sun.measure(spot, aps), by_splines(spot)
    assert np.abs(ours.direction - theirs[0]).max() < 1e-12
    assert np.abs(ours.covariance - theirs[1]).max() < 1e-9 * np.trace(theirs[1])
    centre = relnav.aps_sun.centroid(one, aps.image)
    assert np.abs(labelled_user(one, quiet) - [centre.x_px, centre.y_px]).max() < 1e-9
    return {
        "birefringent_sun.measure": (
            lambda: relnav.birefringent_sun.measure(spots, crystal).direction[0],
            lambda: least_squares_user(crystal, spots)[0][0],
            "scipy least_squares, both orders",
        ),
        "birefringent_sun.measure, 224 x 224": (
            lambda: relnav.birefringent_sun.measure(two, crystal, corner_px=corner).direction[0],
            None,
            "",
        ),
        "aps_sun.measure": (
            lambda: relnav.aps_sun.measure(spot, aps).direction[0],
            lambda: by_splines(spot)[0][0],
            "scipy splines, same grid",
        ),
        "aps_sun.measure, 24 x 24": (
            lambda: relnav.aps_sun.measure(one, aps, corner_px=(500.0, 500.0)).direction[0],
            lambda: labelled_user(one, quiet)[0],
            "scipy label, centre alone",
        ),
    }


def marker_sensor(rng):
    """The same of the three markers: OpenCV's P3P and its refinement, no covariance, roots not compared."""
    model = relnav.load_model("three_marker_vision")
    points, camera = model.markers.points_m, model.camera
    position = np.array([0.3, -0.2, 8.0])
    spots = marker_spots(points @ model.view.dcm_cam_from_target.T + position, camera).spots_px
    spots = spots + 0.05 * rng.normal(size=spots.shape)
    peer, name = None, ""
    if importlib.util.find_spec("cv2") is None:
        print("OpenCV is not installed and left out: pip install opencv-python-headless")
    else:
        import cv2

        (fx, fy), (cx, cy) = camera.focal_length_px, camera.principal_point_px
        matrix, lens = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), np.array(camera.distortion)

        def opencv():
            _, turns, places = cv2.solveP3P(points, spots, matrix, lens, flags=cv2.SOLVEPNP_P3P)
            return [
                (cv2.Rodrigues(r)[0], t[:, 0])
                for r, t in (
                    cv2.solvePnPRefineLM(points, spots, matrix, lens, r, t) for r, t in zip(turns, places, strict=True)
                )
            ]

        ours = relnav.three_marker.measure(spots, model)
        nearest = min(
            max(np.abs(dcm - ours.dcm_cam_from_target).max(), np.abs(place / ours.position_m - 1.0).max())
            for dcm, place in opencv()
        )
        assert nearest < 1e-6, f"OpenCV's nearest pose differs by {nearest:.1e}"
        peer, name = lambda: opencv()[0][1][0], "OpenCV P3P, each root refined"
    return {"three_marker.measure": (lambda: relnav.three_marker.measure(spots, model).position_m[0], peer, name)}


def marker_filter():
    """A step of the marker filter, its covariance read, then port from port with its covariance too; no peer."""
    model = relnav.load_model("three_marker_vision")
    flight = simulate_flight(model, Approach(duration_s=300.0), seed=1)

    def stepping(read):
        def run():
            while True:  # one approach after another
                navigator = relnav.PoseNavigator(model)
                for t, spots in zip(flight.t_s.tolist(), flight.spots_px, strict=True):
                    yield read(navigator.step(t, spots))

        steps = run()
        return lambda: next(steps)

    def docked(record):
        return 0.0 if record.docking is None else record.covariance[0, 0] + record.docking.covariance[0, 0]

    return {
        "PoseNavigator.step, covariance": (stepping(lambda record: record.covariance[0, 0]), None, ""),
        "the same, port from port": (stepping(docked), None, ""),
    }


def other_sensors(rng):
    """Three beacons, and stars: tracking beside the same frame lost in space."""
    beacons, stars = relnav.load_model("three_beacon_psd"), relnav.load_model("dual_field_star")
    spots = np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0001]])
    sky, still = StarFieldSimulator(stars, SkyConditions(5.75, 0.15, 0.0, 0)), np.zeros(3)
    while True:  # a frame with stars of one field alone has no attitude lost in space
        frame = sky.frame(rng)
        known = {"magnitude": frame.magnitude, "velocity_km_s": still}
        if relnav.dual_field.measure(frame.spots_px, stars, **known).ok:
            break

    def lost():
        return relnav.dual_field.measure(frame.spots_px, stars, **known)

    def tracked():
        return relnav.dual_field.track(frame.spots_px, stars, frame.dcm_cam_from_icrs, 1e-4, **known)

    assert np.abs(lost().dcm_cam_from_icrs - tracked().dcm_cam_from_icrs).max() < 1e-9
    return {
        "three_beacon.measure": (lambda: relnav.three_beacon.measure(spots, beacons).range_m, None, ""),
        "dual_field.track": (
            lambda: tracked().dcm_cam_from_icrs[0, 0],
            lambda: lost().dcm_cam_from_icrs[0, 0],
            "dual_field.measure, lost in space",
        ),
    }


def timed(functions, rounds):
    """Microseconds a call of each function, interleaved rounds."""
    calls = []
    for function in functions:
        began = time.thread_time_ns()
        for _ in range(3):
            function()
        calls.append(max(3, int(3e9 * CALL_S / max(1, time.thread_time_ns() - began))))
    times = [[] for _ in functions]
    for _ in range(rounds):
        for function, count, kept in zip(functions, calls, times, strict=True):
            began = time.thread_time_ns()
            for _ in range(count):
                function()
            kept.append((time.thread_time_ns() - began) / count / 1000.0)
    return times


FIRST = """
import time
import numpy as np
import relnav
{call}
began = time.process_time()
call()
print(time.process_time() - began)
"""

STAR_FRAME = """
from relnav.sensors.dual_field.blind import Blind, solve_blind
catalogue = relnav.load_model("ground_camera").catalogue
v = catalogue.directions(2020.0)
v = v[v[:, 2] > 0.97][:30]
call = lambda: solve_blind(Blind(2000.0 * v[:, :2] / v[:, 2:], None, 2000.0), catalogue, 2020.0)
"""

FIRST_CALLS = {
    "birefringent_sun.measure": "call = lambda m=relnav.load_model('birefringent_sun'): "
    "relnav.birefringent_sun.measure([[520.0, 511.0], [590.0, 511.0]], m)",
    "aps_sun.measure": "call = lambda m=relnav.load_model('aps_sun'): relnav.aps_sun.measure([520.0, 500.0], m)",
    "three_marker.measure": "call = lambda m=relnav.load_model('three_marker_vision'): "
    "relnav.three_marker.measure([[562.0, 531.0], [459.0, 532.0], [511.0, 478.0]], m)",
    "dual_field.track": "call = lambda m=relnav.load_model('dual_field_star'): relnav.dual_field.track("
    "np.random.default_rng(1).uniform(-400.0, 400.0, (9, 2)), m, np.eye(3), 1e-5, velocity_km_s=np.zeros(3))",
    "star frame of unknown focal length": STAR_FRAME,
}


def first_calls():
    """CPU seconds of the first call in a fresh process: no compiled code, then with it at hand."""
    rows = []
    print("\nFirst call of a fresh process, CPU s: without compiled code, then with it")
    for name, call in FIRST_CALLS.items():
        with tempfile.TemporaryDirectory() as folder:
            place = os.environ | {"NUMBA_CACHE_DIR": folder}
            command = [sys.executable, "-c", FIRST.format(call=call)]
            cold, warm = (
                float(subprocess.run(command, env=place, capture_output=True, text=True, check=True).stdout)
                for _ in range(2)
            )
        rows.append({"name": name, "cold_s": cold, "warm_s": warm})
        print(f"{name:<38}{cold:>9.2f}{warm:>9.2f}")
    return rows


def main() -> None:
    """Check, measure, print, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--cold", action="store_true", help="time the first call without compiled code too")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    rng, rows = np.random.default_rng(1), []
    entries = other_sensors(rng) | sun_sensors(rng) | marker_sensor(rng) | marker_filter()
    print(f"{'us per call':<38}{'min':>9}{'median':>9}{'peer, median':>14}{'ratio':>8}  peer")
    for name, (call, peer, peer_name) in entries.items():
        ours, *theirs = timed([call] if peer is None else [call, peer], options.rounds)
        row = {"name": name, "us_min": min(ours), "us_median": statistics.median(ours)}
        line = f"{name:<38}{row['us_min']:>9.2f}{row['us_median']:>9.2f}"
        if theirs:
            row |= {"peer": peer_name, "peer_us_median": statistics.median(theirs[0])}
            row["ratio"] = row["peer_us_median"] / row["us_median"]
            line += f"{row['peer_us_median']:>14.1f}{row['ratio']:>8.1f}  {peer_name}"
        rows.append(row)
        print(line)
    report = {"rounds": options.rounds, "rows": rows, "first_calls": first_calls() if options.cold else []}
    if options.out is not None:
        options.out.write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    main()
