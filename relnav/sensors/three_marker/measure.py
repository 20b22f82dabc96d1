"""The system's public call: marker spots of one image in, relative position and attitude with covariance out."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, numbers, one_piece
from relnav.geometry.pose_refinement import invertible, pose_information
from relnav.sensors.measurement import Status
from relnav.sensors.three_marker.as_published import small_angle
from relnav.sensors.three_marker.camera import on_image, usable_into
from relnav.sensors.three_marker.labels import labelled_roots
from relnav.sensors.three_marker.outcome import PoseMeasurement, judged, no_measurement
from relnav.sensors.three_marker.pose import (
    Pose,
    Root,
    belief_of,
    is_gaussian,
    rank_roots,
    ranked_rows,
    root_gap_rad,
    roots_of,
    scratch,
)
from relnav.sensors.three_marker.roots import explain_into, explains_its_error
from relnav.sensors.three_marker.sensor import Imager, MarkerCamera, Markers, View
from relnav.sensors.three_marker.spots import find_spots

METHODS = ("exact", "small_angle")
NO_COVARIANCES = np.empty((0, 2, 2))


class HasMarkers(Protocol):
    """What `measure` needs of a loaded model."""

    @property
    def camera(self) -> MarkerCamera:
        """Camera."""
        ...

    @property
    def markers(self) -> Markers:
        """Markers."""
        ...

    @property
    def view(self) -> View:
        """Expected view."""
        ...


class HasImager(HasMarkers, Protocol):
    """What `measure_image` needs of a loaded model."""

    @property
    def imager(self) -> Imager:
        """Imager."""
        ...


def measure(
    spots_px: ArrayLike,
    model: HasMarkers,
    *,
    prior: Pose | None = None,
    spot_covariance_px2: ArrayLike | None = None,
    labelled: bool = True,
    method: str = "exact",
) -> PoseMeasurement:
    """Relative position and attitude of camera and target, from one image of the markers.

    Parameters
    ----------
    spots_px : (n, 2)
        Spots, px; labelled: one row a marker of the model, in its order, NaN = not seen. Three or more are needed.
    model : ThreeMarkerModel
        A loaded model.
    prior : Pose, optional
        Predicted pose with its covariance, which distinguishes the roots; the model's expected view if left out. It
        does not enter the result.
    spot_covariance_px2 : (n, 2, 2), optional
        Of each spot, as `find_spots` gives it; the camera's spot noise if left out.
    labelled : bool
        False: any number of spots in any order; their assignment to markers is found, and returned in `labels`.
    method : {"exact", "small_angle"}, optional
        "exact" is P3P and Gauss-Newton. "small_angle" is the analytic solution of Liu, Xu, Xu (2013), "Vision-based
        relative navigation for autonomous rendezvous and docking of spacecraft", about the prior's attitude. Its
        covariance is that of the noise and leaves its own error out (about 0.007 deg per square degree at best).

    Returns
    -------
    PoseMeasurement
        Bad data never raise: the status says why there is no value.

    Raises
    ------
    ValueError
        For spots or covariances of another shape, an unknown method, or the small-angle method without labels.
    """
    spots, covariance = _checked(spots_px, spot_covariance_px2, len(model.markers.positions_m) if labelled else None)
    if method not in METHODS:
        raise ValueError(f'method must be "exact" or "small_angle"; got {method!r}')
    if method == "small_angle" and not labelled:
        raise ValueError('method "small_angle" needs labelled spots: use "exact" for spots in any order')
    if prior is not None and not all(np.isfinite(part).all() for part in vars(prior).values()):
        raise ValueError("prior is a finite pose; a measurement whose status is not OK has none: leave the prior out")
    n = len(spots)
    xy, weights, which, labels = np.empty((n, 2)), np.empty((n, 3)), np.empty(n, dtype=np.int64), [-1] * n
    own = NO_COVARIANCES if covariance is None else covariance
    count = usable_into(spots, own, model.camera.lens, xy, weights, which)
    if count < 3:
        off = bool((~on_image(spots, model.camera) & ~np.isnan(spots).any(axis=-1)).any())
        return no_measurement(Status.OFF_DETECTOR if off else Status.NOT_SEEN, labels)
    seen = points = model.markers.points_m
    belief, usable = model.view if prior is None else prior, which.tolist()
    if count < n:
        xy, weights, usable = xy[:count], weights[:count], usable[:count]
    if not labelled:
        return _without_labels(xy, weights, points, belief, usable, labels)
    for k in usable:
        labels[k] = k
    if count < n:
        seen = points[usable]
    if method == "small_angle":
        roots = _small_angle_roots(xy, weights, seen, belief)
        return judged(roots, labels, count, root_gap_rad(roots), gaussian=True, gated=False)
    poses, information, misfit, work = scratch()
    found = explain_into(xy, weights, seen, poses, information, misfit, work)
    if found == 0:
        return no_measurement(Status.NO_CONVERGENCE, labels)
    rows, gap = ranked_rows(poses, information, misfit, found, belief_of(belief), work)
    gaussian = explains_its_error(rows[0], xy, weights, seen, work)
    return judged(roots_of(rows), labels, count, gap, gaussian=gaussian)


def _without_labels(
    xy: Matrix, weights: Matrix, points: Matrix, belief: Pose | View, usable: list[int], labels: list[int]
) -> PoseMeasurement:
    """Measurement of spots in any order; writes which marker made which into labels."""
    entries = labelled_roots(xy, weights, points, belief)
    if not entries:
        return no_measurement(Status.NO_CONVERGENCE, labels)
    used = [k for k, label in enumerate(entries[0].labels) if label >= 0]
    markers = [entries[0].labels[k] for k in used]
    for k, label in zip(used, markers, strict=True):
        labels[usable[k]] = label
    roots = [entry.root for entry in entries]
    gaussian = is_gaussian(roots[0], xy[used], weights[used], points[markers])
    return judged(roots, labels, len(used), root_gap_rad(roots), gaussian=gaussian)


def measure_image(image_dn: ArrayLike, model: HasImager, *, prior: Pose | None = None) -> PoseMeasurement:
    """Relative position and attitude from an image: `find_spots`, then `measure` of those that are usable.

    Parameters
    ----------
    image_dn : (height, width)
        Digital numbers.
    model : ThreeMarkerModel
        A loaded model.
    prior : Pose, optional
        As in `measure`; it is also used to assign the spots to markers.

    Returns
    -------
    PoseMeasurement
        `labels` has one entry a spot used, the brightest first.

    Raises
    ------
    ValueError
        If the image does not have the camera's size.
    """
    image = numbers("image_dn", image_dn)
    width, height = model.camera.image_size_px
    if image.shape != (height, width):
        raise ValueError(f"image_dn has shape (height, width) = {(height, width)}; got {image.shape}")
    spots = find_spots(image, model.imager)
    return measure(
        spots.spots_px[spots.usable],
        model,
        prior=prior,
        spot_covariance_px2=spots.covariance_px2[spots.usable],
        labelled=False,
    )


def _checked(
    spots_px: ArrayLike, spot_covariance_px2: ArrayLike | None, markers: int | None
) -> tuple[Matrix, Matrix | None]:
    spots = one_piece("spots_px", spots_px)
    if spots.ndim != 2 or spots.shape[1] != 2 or (markers is not None and len(spots) != markers):
        want = "(n, 2)" if markers is None else f"({markers}, 2), one row a marker"
        raise ValueError(f"spots_px has shape {want}, columns x, y in px; got {spots.shape}")
    if spot_covariance_px2 is None:
        return spots, None
    covariance = one_piece("spot_covariance_px2", spot_covariance_px2)
    if covariance.shape != (len(spots), 2, 2):
        raise ValueError(f"spot_covariance_px2 has shape ({len(spots)}, 2, 2), one a spot; got {covariance.shape}")
    return spots, covariance


def _small_angle_roots(xy: Matrix, weights: Matrix, points: Matrix, belief: Pose | View) -> list[Root]:
    start = small_angle(xy, points, belief.dcm_cam_from_target)
    if not np.isfinite(start).all():
        return []
    information = np.empty((6, 6))
    misfit = pose_information(points, xy, weights, start, information, np.empty(6))
    usable = np.isfinite(misfit) and invertible(information)
    return rank_roots([(start, information, misfit)], belief) if usable else []
