"""`relnav stars solve` on pictures: attitude, spots, world coordinates, a drawing; and what goes wrong."""

import dataclasses
import json
import warnings

import numpy as np
import pytest

import relnav
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator
from relnav.simulation.star_picture import Exposure, picture_of

Image = pytest.importorskip("PIL.Image", reason="pillow, of the extra `images`, is not installed")
SIZE = (1024, 768)


@pytest.fixture(scope="module")
def sky():
    """A simulated picture of the ground camera, its true attitude, and the model."""
    model = relnav.load_model("ground_camera")
    conditions = SkyConditions(faintest_mag=7.0, missing=0.0, false_spots=0, field_radius_rad=np.radians(7.1))
    rng = np.random.default_rng(4)
    frame = StarFieldSimulator(model, conditions).frame(rng)
    exposure = Exposure(zero_point=16.92)
    picture = picture_of(frame.spots_px, exposure.flux(frame.magnitude), SIZE, exposure, rng)
    return picture.astype(np.uint16), frame.dcm_cam_from_icrs, model.camera


def off_arcsec(values, dcm):
    """Angle between two boresights."""
    return 206265.0 * np.linalg.norm(np.array(values["dcm_cam_from_icrs"])[2] - dcm[2])


def solve(run, tmp_path, picture, *options):
    code, out, err = run("stars", "solve", picture, *options, "--json", tmp_path / "out.json")
    assert (code, err) == (0, "")
    return out, json.loads((tmp_path / "out.json").read_text())


def test_with_a_model_and_everything_written(run, tmp_path, sky):
    counts, dcm, _ = sky
    Image.fromarray(counts).save(tmp_path / "sky.png")
    written = ["--spots", tmp_path / "spots.csv", "--plot", tmp_path / "plot.svg"]
    out, values = solve(run, tmp_path, tmp_path / "sky.png", "--model", "ground_camera", *written)
    assert out.startswith("ok: right ascension")
    assert off_arcsec(values, dcm) < 5.0 * values["sigma_arcsec"][0]
    assert values["centre_px"] == [511.5, 383.5]
    assert (tmp_path / "plot.svg").read_bytes().startswith(b"<?xml")
    head, *rows = [line for line in (tmp_path / "spots.csv").read_text().splitlines() if not line.startswith("#")]
    assert head.startswith("x_px,y_px,flux,sigma_x_px")
    assert len(rows) >= values["matches"] >= 25
    _, again = solve(run, tmp_path, tmp_path / "spots.csv", "--model", "ground_camera")
    np.testing.assert_allclose(again["dcm_cam_from_icrs"], values["dcm_cam_from_icrs"], atol=1e-9)


def test_streaks_are_named_where_they_are_no_attitude(run, tmp_path, sky):
    """The same sky while the camera turned by 20 px; a picture of round stars that is not solved has no such line."""
    _, dcm, camera = sky
    model, rng = relnav.load_model("ground_camera"), np.random.default_rng(3)
    conditions = SkyConditions(faintest_mag=6.5, missing=0.0, false_spots=0, field_radius_rad=np.radians(7.1))
    frame, exposure = StarFieldSimulator(model, conditions).frame(rng, dcm=dcm), Exposure(zero_point=16.92)
    for length, said in ((20.0, True), (0.0, False)):
        trail = np.linspace(-0.5, 0.5, 50)[:, None] * [0.8 * length, 0.6 * length]
        light, flux = (frame.spots_px[:, None] + trail).reshape(-1, 2), exposure.flux(frame.magnitude) / len(trail)
        picture = picture_of(light, np.repeat(flux, len(trail)), SIZE, exposure, rng)
        Image.fromarray(picture.astype(np.uint16)).save(tmp_path / "sky.png")
        out, values = solve(run, tmp_path, tmp_path / "sky.png", "--focal-px", 3.0 * camera.focal_length_px)
        assert values["status"] == "no_match"
        assert ("spots are elongated: if the camera turned during the exposure, expose shorter" in out) == said


@pytest.mark.parametrize("kind", ["jpeg of 8 bits", "tiff, focal length 25 % off", "mirrored", "another exposure"])
def test_other_pictures(run, tmp_path, sky, kind):
    counts, dcm, camera = sky
    path, options = tmp_path / "sky.tif", ["--focal-px", "5000"]
    if kind.startswith("jpeg"):
        path = tmp_path / "sky.jpg"
        Image.fromarray(np.clip(counts // 40, 0, 255).astype(np.uint8)).save(path, quality=92)
    elif kind.startswith("tiff"):
        Image.fromarray(counts).save(path)
        options = ["--focal-px", "4100", "--focal-error", "30"]
    elif kind == "mirrored":
        Image.fromarray(np.ascontiguousarray(counts[::-1])).save(path)
        options += ["--mirrored"]
    else:
        Image.fromarray((counts / 9.0 + 300.0).astype(np.uint16)).save(path)
        options = ["--model", "ground_camera"]
    _, values = solve(run, tmp_path, path, *options)
    assert values["status"] == "ok"
    assert values["mirrored"] == (kind == "mirrored")
    assert values["focal_length_px"] == pytest.approx(camera.focal_length_px, rel=2e-3)
    lens = np.array(values["lens"]["dcm_from_icrs"])
    assert 206265.0 * np.linalg.norm(lens[2] - dcm[2]) < (3600.0 if "model" not in options[0] else 10.0)
    assert ("brightness was not compared" in values["reason"]) == (kind == "another exposure")


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("moving", [False, True])
def test_world_coordinates(run, tmp_path, sky, mirrored, moving, outside):
    """Astropy puts pixels where the true camera has them: known optics, and estimated ones; and back to 1e-4 px."""
    fits = pytest.importorskip("astropy.io.fits", reason="astropy, of the extra `images`, is not installed")
    from astropy.wcs import WCS, FITSFixedWarning

    from relnav.geometry.star_places import LIGHT_KM_S, aberration
    from relnav.sensors.dual_field.optics import plane_points, rays

    counts, dcm, camera = sky
    Image.fromarray(np.ascontiguousarray(counts[::-1]) if mirrored else counts).save(tmp_path / "sky.tif")
    velocity = np.array([20.0, -15.0, 10.0]) if moving else np.zeros(3)
    options = ["--model", "ground_camera", *(["--mirrored"] if mirrored else [])]
    options += ["--epoch", "2019.575", "--velocity-km-s", *velocity] if moving else []
    solve(run, tmp_path, tmp_path / "sky.tif", *options, "--wcs", tmp_path / "sky.fits")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FITSFixedWarning)  # a header without a picture
        wcs = WCS(fits.getheader(tmp_path / "sky.fits"))
    pixels = np.stack(np.meshgrid(np.linspace(0, 1023, 5), np.linspace(0, 767, 5)), axis=-1).reshape(-1, 2)
    seen = pixels - [511.5, 383.5]
    seen[:, 1] *= -1.0 if mirrored else 1.0
    points = plane_points(seen, camera.focal_length_px, camera.principal_point_px, camera.distortion)
    # the picture has no aberration: an observer who says that he moves is told other places, by as much as he moves
    true = rays(points) @ dcm
    if moving:
        true = aberration(true, -velocity / LIGHT_KM_S)
    got = np.radians(wcs.all_pix2world(pixels, 0))
    place = np.stack(
        [np.cos(got[:, 1]) * np.cos(got[:, 0]), np.cos(got[:, 1]) * np.sin(got[:, 0]), np.sin(got[:, 1])], 1
    )
    observer = "an observer at 30 km/s" if moving else "an observer at rest"
    what = f"places of a solved picture's pixels, {observer}, the solution's own error included, arcsec"
    off = 206265.0 * np.linalg.norm(place - true, axis=1).max()
    outside("astropy WCS (TAN-SIP header)", what, off, 25.0 if moving else 8.0)
    np.testing.assert_allclose(wcs.all_world2pix(np.degrees(got), 0), pixels, atol=1e-4)
    np.testing.assert_allclose(wcs.sip_foc2pix(wcs.sip_pix2foc(pixels, 0), 0), pixels, atol=1e-3)


REFUSED = {
    "centre of a picture": (["sky.png", "--centre-px", "1", "2"], 2, "--centre-px is for a CSV of spots"),
    "saturation of spots": (["spots.csv", "--saturation", "200"], 2, "--saturation is for a picture"),
    "spots of spots": (["spots.csv", "--spots", "other.csv"], 2, "--spots is for a picture"),
    "spots as text": (["sky.png", "--spots", "other.txt"], 2, "a table ends in .csv or .parquet"),
    "size unknown": (["spots.csv", "--wcs", "a.fits"], 2, "--wcs needs the size of the picture"),
    "header's ending": (["sky.png", "--wcs", "a.txt"], 2, "a FITS header ends in .fits or .wcs"),
    "first pixel alone": (["spots.csv", "--first-pixel-px", "0.5"], 2, "--first-pixel-px needs --image-size-px"),
    "focal length anywhere": (["sky.png", "--focal-error", "90"], 2, "--focal-error"),
    "no star": (["dark.png"], 3, "20 x 30 px and no star"),
    "no picture": (["bad.png"], 3, "not a readable picture"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(run, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spots.csv").write_text("x_px,y_px,flux\n1,2,3\n")
    (tmp_path / "bad.png").write_text("no picture")
    for file in ("dark.png", "sky.png"):
        Image.fromarray(np.full((30, 20), 9, dtype=np.uint8)).save(file)
    before = sorted(tmp_path.iterdir())
    arguments, expected, text = REFUSED[name]
    code, out, err = run("stars", "solve", *arguments, "--focal-px", "5000")
    assert (code, out) == (expected, "")
    assert text in err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(("package", "file"), [("PIL", "sky.png"), ("astropy", "sky.fits")])
def test_a_missing_package_is_named(run, tmp_path, monkeypatch, package, file):
    import sys

    for name in [name for name in sys.modules if name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / file).write_bytes(b"SIMPLE")
    code, _, err = run("stars", "solve", tmp_path / file, "--focal-px", "5000")
    assert code == 2
    assert "pip install 'relnav[images]'" in err


def test_a_model_says_how_its_spots_count(run, tmp_path, sky):
    """The key `first_pixel_px` of [camera], the option, and spots from the centre: one attitude."""
    from relnav.files.model_folders import models_root

    model = tmp_path / "model.toml"
    text = (models_root() / "ground_camera" / "model.toml").read_text()
    line = 'first_pixel_px = { value = "0.5", source = "assumed", why = "of this test" }\n'
    model.write_text(text.replace("spot_noise_px", line + "spot_noise_px", 1))
    found = relnav.find_stars(sky[0])
    answers = []
    for name, shift, options in (
        ("centre", np.zeros(2), ["--model", "ground_camera"]),
        ("option", found.in_picture_px[0] - found.spots_px[0], ["--model", "ground_camera", "--first-pixel-px", "0"]),
        ("key", np.array([512.0, 384.0]), ["--model", model]),
    ):
        rows = np.column_stack([found.spots_px + shift, found.flux])
        np.savetxt(tmp_path / f"{name}.csv", rows, "%.9f", ",", header="x_px,y_px,flux", comments="")
        answers.append(solve(run, tmp_path, tmp_path / f"{name}.csv", *options)[1]["dcm_cam_from_icrs"])
    np.testing.assert_allclose(answers[1], answers[0], atol=1e-9)
    np.testing.assert_allclose(answers[2], answers[0], atol=1e-9)


def test_each_spot_counts_by_its_own_noise(run, tmp_path):
    """Of stars without other noise than the picture's: a third of the model's sigma, and the error is within it."""
    model, rng = relnav.load_model("ground_camera"), np.random.default_rng(4)
    exact = dataclasses.replace(model, camera=dataclasses.replace(model.camera, spot_noise_px=1e-9))
    conditions = SkyConditions(faintest_mag=7.0, missing=0.0, false_spots=0, field_radius_rad=np.radians(7.1))
    frame, exposure = StarFieldSimulator(exact, conditions).frame(rng), Exposure(zero_point=16.92)
    picture = picture_of(frame.spots_px, exposure.flux(frame.magnitude), SIZE, exposure, rng)
    Image.fromarray(picture.astype(np.uint16)).save(tmp_path / "sky.png")
    gain = ["--electrons-per-count", 1.0 * exposure.electrons_per_count]
    written = ["--model", "ground_camera", "--residual-px", 0.01]
    sky = tmp_path / "sky.png"
    _, alike = solve(run, tmp_path, sky, "--model", "ground_camera")
    _, own = solve(run, tmp_path, sky, *written, *gain, "--spots", tmp_path / "spots.csv")
    _, again = solve(run, tmp_path, tmp_path / "spots.csv", *written)
    assert own["sigma_arcsec"][0] < alike["sigma_arcsec"][0] / 3.0
    assert off_arcsec(own, frame.dcm_cam_from_icrs) < 4.0 * own["sigma_arcsec"][0]
    np.testing.assert_allclose(again["covariance_rad2"], own["covariance_rad2"], rtol=1e-6)
    _, wide = solve(run, tmp_path, tmp_path / "spots.csv", "--model", "ground_camera", "--residual-px", 1.0)
    assert wide["sigma_arcsec"][0] > 5.0 * alike["sigma_arcsec"][0]
    mirrored = picture[::-1].astype(np.uint16)
    Image.fromarray(mirrored).save(sky)
    _, back = solve(run, tmp_path, sky, *written, *gain, "--mirrored")
    np.testing.assert_allclose(back["covariance_rad2"], own["covariance_rad2"], rtol=0.02, atol=1e-14)
