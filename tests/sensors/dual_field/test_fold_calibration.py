"""The mirror from the sky: from one frame without a prior, jointly over many, to what the noise allows."""

import numpy as np
import pytest

from relnav.sensors.dual_field.fold import mirror_fold
from relnav.sensors.dual_field.fold_calibration import IdentifiedFrame, calibrate_fold, estimate_fold, normal_error
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

NORMAL = np.array([1.0, 0.03, -1.1]) / np.linalg.norm([1.0, 0.03, -1.1])
ARCSEC = np.radians(1.0 / 3600.0)


@pytest.fixture(scope="module")
def simulator(sensor):
    return StarFieldSimulator(sensor, SkyConditions(), mirror_fold(NORMAL))


def identified(frame, sensor, as_rays, sky):
    """A frame with its true stars."""
    u, sigma = as_rays(frame, sensor)
    place = {int(h): k for k, h in enumerate(sky.hip)}
    used = frame.hip > 0
    v = sky.arrays.stars[[place[int(h)] for h in frame.hip[used]], :3]
    return IdentifiedFrame(u[used], v, frame.field[used], sigma[used])


def test_from_one_frame_without_a_prior(sensor, simulator, as_rays):
    """The mirror is 2.7 deg and 1.1 deg from the nominal one, which is told to nobody."""
    rng, sigmas, possible, found = np.random.default_rng(1), [], 0, 0
    for _ in range(60):
        frame = simulator.frame(rng)
        u, sigma = as_rays(frame, sensor)
        possible += min(np.sum(frame.field == 0), np.sum(frame.field == 1)) >= 5
        estimate = estimate_fold(u, sensor.sky(), sigma_rad=sigma, magnitude=frame.magnitude)
        if estimate is not None:
            found += 1
            sigmas.append(normal_error(estimate, NORMAL) / np.sqrt(np.diagonal(estimate.covariance)))
    assert found >= 0.97 * possible
    assert np.abs(sigmas).max() < 5.0
    assert np.sqrt(np.mean(np.square(sigmas), axis=0)) == pytest.approx([1.0, 1.0], abs=0.35)


def test_jointly_over_frames(sensor, simulator, as_rays):
    """Ten frames: 1.1 arcsec out of the plane and 0.12 in it; the covariance is that of the scatter."""
    rng, errors, sigma = np.random.default_rng(2), [], None
    for _ in range(40):
        frames = [identified(simulator.frame(rng), sensor, as_rays, sensor.sky()) for _ in range(10)]
        estimate = calibrate_fold(frames, NORMAL + np.array([0.0, 1e-3, 1e-3]))
        errors.append(normal_error(estimate, NORMAL))
        sigma = np.sqrt(np.diagonal(estimate.covariance))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms == pytest.approx(sigma, rel=0.4)
    assert rms[0] < 0.25 * ARCSEC
    assert rms[1] < 1.5 * ARCSEC
    assert estimate.dcm_cam_from_icrs.shape == (10, 3, 3)


def test_it_converges_without_noise_to_the_last_digits(sensor, as_rays):
    import dataclasses

    still = dataclasses.replace(sensor, camera=dataclasses.replace(sensor.camera, spot_noise_px=1e-9))
    simulator = StarFieldSimulator(still, SkyConditions(), mirror_fold(NORMAL))
    frames = [identified(simulator.frame(np.random.default_rng(3)), sensor, as_rays, sensor.sky())]
    assert np.abs(normal_error(calibrate_fold(frames, NORMAL + 5e-3), NORMAL)).max() < 1e-11


def test_one_field_alone_does_not_fix_it(sensor, simulator, as_rays):
    frame = identified(simulator.frame(np.random.default_rng(4)), sensor, as_rays, sensor.sky())
    alone = frame.field == 0
    part = IdentifiedFrame(frame.u[alone], frame.v[alone], frame.field[alone], frame.sigma_rad[alone])
    with pytest.raises(ValueError, match="do not fix the mirror"):
        calibrate_fold([part], NORMAL)
