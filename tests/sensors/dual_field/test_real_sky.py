"""Four frames of the real sky: solved, right against an independent solver, and two by two as dual-field frames."""

import csv
import dataclasses
import json
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

import relnav
from relnav.geometry.rotation_vector import attitude_error
from relnav.sensors.dual_field.blind import Blind, solve_blind
from relnav.sensors.dual_field.fold_calibration import MIRRORED, identify_without_fold
from relnav.sensors.dual_field.identify import identify
from relnav.sensors.dual_field.optics import plane_points, ray_sigma, rays

FOLDER = Path(__file__).parents[2] / "data" / "real_sky"
REFERENCE = json.loads((FOLDER / "reference.json").read_text())
NAMES = sorted(REFERENCE)
OTHERS = json.loads((FOLDER / "other_cameras.json").read_text())
ARCSEC = np.degrees(1.0) * 3600.0


def read(name):
    """Spots (n, 2) px and fluxes (n,) of a frame."""
    with (FOLDER / f"{name}.csv").open() as file:
        rows = [[float(row[key]) for key in ("x_px", "y_px", "flux")] for row in csv.DictReader(file)]
    table = np.array(rows)
    return table[:, :2], table[:, 2]


@pytest.fixture(scope="module")
def camera():
    return relnav.load_model("ground_camera")


@pytest.fixture(scope="module")
def frames():
    """Name -> spots (40, 2) px and fluxes (40,)."""
    return {name: read(name) for name in NAMES}


@pytest.fixture(scope="module")
def solutions(camera, frames):
    return {name: relnav.dual_field.measure(spots, camera, flux=flux) for name, (spots, flux) in frames.items()}


def test_all_four_are_solved(solutions):
    for solution in solutions.values():
        assert solution.status == "ok"
        assert solution.matches >= 29
        assert solution.log10_false_alarm < -80
        assert np.sqrt(np.nanmean(solution.residual_rad**2)) * ARCSEC < 9.0


def test_they_agree_with_the_independent_solver(solutions, outside):
    """A constant offset is the principal point (10.7 and 10.1 px), which that solver puts into the image's centre."""
    offset = np.array(
        [attitude_error(solutions[n].dcm_cam_from_icrs, np.array(REFERENCE[n]["dcm_cam_from_icrs"])) for n in NAMES]
    )
    scatter = offset[:, :2] - offset[:, :2].mean(axis=0)
    off = np.abs(scatter * ARCSEC).max()
    outside("tetra3rs 0.14.0 on four frames of the real sky", "attitude across the boresight, arcsec", off, 5.0)
    assert offset.mean(axis=0)[:2] * ARCSEC == pytest.approx([406.0, 430.0], abs=5.0)
    assert np.abs(offset[:, 2] * ARCSEC).max() < 40.0  # roll is known to 15 arcsec from one field


@pytest.mark.parametrize("focal", [0.97, 1.02])
def test_with_the_focal_length_alone(camera, frames, focal):
    """No distortion known, the focal length up to 3 % wrong: the same attitude as the independent solver's."""
    for name, (spots, flux) in frames.items():
        blind = Blind(spots, -2.5 * np.log10(flux), 5114.0 * focal)
        solution = solve_blind(blind, camera.catalogue, 2019.6)
        assert solution.status == "ok"
        assert solution.focal_length_px == pytest.approx(5114.4, abs=5.0)
        e = attitude_error(solution.dcm_cam_from_icrs, np.array(REFERENCE[name]["dcm_cam_from_icrs"])) * ARCSEC
        assert np.abs(e[:2]).max() < 5.0
        assert abs(e[2]) < 40.0


@pytest.mark.parametrize("focal", [0.9, 1.5])
def test_with_a_focal_length_far_off_it_is_refused(camera, frames, focal):
    spots, flux = frames[NAMES[1]]
    solution = solve_blind(Blind(spots, -2.5 * np.log10(flux), 5114.0 * focal), camera.catalogue, 2019.6)
    assert solution.status == "no_match"
    assert "no attitude with a focal length within 5%" in solution.reason


def test_a_mirrored_frame_is_refused_with_the_reason(camera, frames):
    spots, flux = frames[NAMES[1]]
    for mirrored in (spots * (1.0, -1.0),):
        solution = solve_blind(Blind(mirrored, -2.5 * np.log10(flux), 5100.0), camera.catalogue, 2019.6)
        assert solution.status == "no_match"
        assert "mirrored it does" in solution.reason
        assert not relnav.dual_field.measure(mirrored, camera, flux=flux).ok


def test_the_wrong_camera_is_refused(camera, frames):
    """Another lens's frame under this model: no attitude rather than a wrong one."""
    for scale in (0.5, 0.98, 1.005, 1.02, 2.0):
        other = dataclasses.replace(camera, camera=dataclasses.replace(camera.camera, focal_length_px=5114.38 * scale))
        for name in NAMES[1:3]:
            spots, flux = frames[name]
            solution = relnav.dual_field.measure(spots, other, flux=flux)
            if solution.ok:
                truth = np.array(REFERENCE[name]["dcm_cam_from_icrs"])
                assert np.trace(solution.dcm_cam_from_icrs @ truth.T) > 3.0 - 1e-3


def superimposed(frames, camera, first, second):
    """Two frames on one detector, the second mirrored in x as a half mirror shows it."""
    points, magnitude, origin = [], [], []
    lens = camera.camera
    for k, name in enumerate((first, second)):
        spots, flux = frames[name]
        p = plane_points(spots, lens.focal_length_px, lens.principal_point_px, lens.distortion)
        points.append(p * ((-1.0, 1.0) if k else (1.0, 1.0)))
        magnitude.append(camera.identification.magnitude_zero_point - 2.5 * np.log10(flux))
        origin.append(np.full(len(p), k))
    order = np.argsort(np.concatenate(magnitude))
    p = np.concatenate(points)[order]
    sigma = ray_sigma(p, lens.spot_noise_px, lens.focal_length_px)
    return rays(p), sigma, np.concatenate(magnitude)[order], np.concatenate(origin)[order], order


@pytest.mark.parametrize(("first", "second"), list(permutations(NAMES, 2)))
def test_two_frames_make_a_dual_field_frame(camera, frames, solutions, first, second):
    """All 12 ordered pairs: star and field of every spot as in the frames apart, with the fold known and unknown."""
    u, sigma, magnitude, origin, order = superimposed(frames, camera, first, second)
    apart = np.concatenate([solutions[first].hip, solutions[second].hip])[order]
    A, B = solutions[first].dcm_cam_from_icrs, solutions[second].dcm_cam_from_icrs
    fold = A @ B.T @ MIRRORED
    options = {"sigma_rad": sigma, "magnitude": magnitude, "gate": camera.identification.magnitude_gate}
    known = identify(u, camera.sky(), fold=fold, **options)
    assert known.status == "ok"
    assert np.trace(known.dcm_cam_from_icrs @ A.T) > 3.0 - 1e-8
    both = (known.hip > 0) & (apart > 0)
    assert np.sum(both) >= 0.97 * np.sum(apart > 0)
    assert np.array_equal(known.hip[both], apart[both])
    assert np.array_equal(known.field[both], origin[both])
    a, b = identify_without_fold(u, camera.sky(), **options)
    assert a.status == b.status == "ok"
    first_is_a = np.trace(a.dcm_cam_from_icrs @ A.T) > 2.9999
    if first_is_a:
        assert np.trace(b.dcm_cam_from_icrs @ B.T) > 3.0 - 1e-6
    wanted = 0 if first_is_a else 1
    assert first_is_a, "the unmirrored field is the one that is found first"
    for solution, index in ((a, wanted), (b, 1 - wanted)):
        matched = (solution.hip > 0) & (apart > 0)
        assert np.array_equal(solution.hip[matched], apart[matched])
        assert np.all(origin[matched] == index)


@pytest.mark.parametrize("name", OTHERS)
def test_skies_of_other_cameras(camera, name, outside):
    """Lenses that distort, of which nobody knows more than a focal length: 25 and 11 arcsec are left in the stars."""
    spots, flux = read(name)
    blind = Blind(spots, -2.5 * np.log10(flux), OTHERS[name]["focal_length_px"])
    solution = solve_blind(blind, camera.catalogue, 2020.0)
    assert solution.status == "ok"
    assert solution.log10_false_alarm < -50
    off = attitude_error(solution.dcm_cam_from_icrs, np.array(OTHERS[name]["dcm_cam_from_icrs"])) * ARCSEC
    across = np.abs(off[:2]).max()
    outside(f"tetra3rs 0.14.0 on another camera's sky, {name}", "attitude across the boresight, arcsec", across, 10.0)
    assert abs(off[2]) < 3.0 * np.sqrt(solution.covariance[2, 2]) * ARCSEC  # about it, known to 42 and 16 arcsec
