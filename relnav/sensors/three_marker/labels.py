"""Which marker made which spot, when the image does not say: every labelling that a pose near the prior explains."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix
from relnav.geometry.p3p import p3p
from relnav.geometry.pinhole import central_projection
from relnav.sensors.three_marker.camera import unit_rays
from relnav.sensors.three_marker.pose import Pose, Root, explaining_poses, rank_roots
from relnav.sensors.three_marker.sensor import View

_NEAR = 0.05  # of the pattern's extent in the image: a spot farther than that from every marker is not one of them
_MOST_SPOTS_TRIED = 6


@dataclass(frozen=True)
class LabelledRoot:
    """A root under one labelling: `labels[k]` is the marker of spot k, -1 for none."""

    root: Root
    labels: tuple[int, ...]


def _assign(xy: Matrix, pose: Matrix, points_m: Matrix, radius: float) -> tuple[int, ...]:
    """Label each spot with the marker that projects nearest to it within the radius, no marker twice."""
    p = points_m @ pose[:3].T + pose[3]
    if not (p[:, 2] > 0.0).all():
        return ()
    distance = np.linalg.norm(xy[:, None] - central_projection(p)[None], axis=-1)
    labels = [-1] * len(xy)
    for spot, marker in sorted(np.ndindex(*distance.shape), key=lambda pair: float(distance[pair])):
        if distance[spot, marker] > radius:
            break
        if labels[spot] < 0 and marker not in labels:
            labels[spot] = marker
    return tuple(labels)


def labelled_roots(xy: Matrix, weights: Matrix, points_m: Matrix, prior: Pose | View) -> list[LabelledRoot]:
    """Roots over all labellings of spots (k, 2), k >= 3, the most credible first.

    Triples of spots are tried against every ordered triple of markers by P3P; the pose labels the rest. Labellings that
    explain more spots come before those that explain fewer; among them, spots and prior decide.
    """
    rays = unit_rays(xy)
    extent = float(np.linalg.norm(xy - xy.mean(axis=0), axis=-1).max())
    noise = 1.0 / math.sqrt(float(np.min(weights[:, [0, 2]])))
    radius = max(_NEAR * extent, 5.0 * noise)
    seen: set[tuple[int, ...]] = set()
    spots = range(min(len(xy), _MOST_SPOTS_TRIED))
    for triple in itertools.combinations(spots, 3):
        for markers in itertools.permutations(range(len(points_m)), 3):
            for pose in p3p(rays[list(triple)], points_m[list(markers)]):
                labels = _assign(xy, pose, points_m, radius)
                if sum(label >= 0 for label in labels) >= 3:
                    seen.add(labels)
    most = max((sum(label >= 0 for label in labels) for labels in seen), default=0)
    found = []
    for labels in sorted(seen):
        if sum(label >= 0 for label in labels) < most:
            continue
        spot = [k for k, label in enumerate(labels) if label >= 0]
        marker = [labels[k] for k in spot]
        for root in rank_roots(explaining_poses(xy[spot], weights[spot], points_m[marker]), prior):
            found.append(LabelledRoot(root, labels))
    return sorted(found, key=lambda entry: entry.root.score)
