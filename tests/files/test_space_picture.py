"""The approach in space: one scale, the path where it was, ellipsoids with room, words that do not collide."""

import itertools
import math

import numpy as np
import pytest
from mpl_toolkits.mplot3d.proj3d import proj_transform

import relnav
from relnav.files.approach_view import Place
from relnav.files.filter_log import filter_log
from relnav.files.run_view import watcher_of
from relnav.files.space_picture import APART, LARGEST, USUAL, magnification, with_room
from relnav.files.track_picture import track_figures


def of(solution, corridor_deg=10.0):
    """View, sheet and its axes, drawn."""
    watcher = watcher_of(relnav.load_model(solution.model), 1500)
    watcher.take(solution)
    view = watcher.view()
    figure = next(f for f in track_figures(view, corridor_deg) if "in space" in f.get_suptitle())
    figure.canvas.draw()
    (axis,) = figure.axes
    return view, figure, axis


@pytest.fixture(scope="module")
def approach(vbar_log):
    return filter_log(vbar_log, "three_beacon_psd")


@pytest.fixture(scope="module", params=["beacons", "markers"])
def drawn(request):
    return of(request.getfixturevalue("approach" if request.param == "beacons" else "poses"))


def segments(axis, label):
    """The curves that are named so together."""
    return [line for one in axis.collections if str(one.get_label()).startswith(label) for line in one._segments3d]


def curve(axis, label):
    """Points of a curve, or of all that are named so, in docking axes, m."""
    for line in axis.lines:
        if line.get_label() == label:
            return np.array(line.get_data_3d())
    return np.vstack(segments(axis, label))


def test_the_path_is_where_it_was(drawn):
    view, _, axis = drawn
    place, _ = view.place()
    place = place[:, np.isfinite(place).all(axis=0)]
    np.testing.assert_array_equal(curve(axis, "estimate"), place)
    np.testing.assert_array_equal(curve(axis, "end")[:, 0], place[:, -1])
    np.testing.assert_array_equal(curve(axis, "shadow of the estimate")[:2], place[:2])
    np.testing.assert_array_equal(curve(axis, "port"), np.zeros((3, 1)))


def test_axes_have_one_scale_and_hold_what_is_drawn(drawn):
    _, figure, axis = drawn
    limits = np.array([axis.get_xlim(), axis.get_ylim(), axis.get_zlim()])
    sizes = np.abs(np.diff(limits)[:, 0])
    np.testing.assert_allclose(axis._box_aspect / axis._box_aspect[0], sizes / sizes[0], rtol=1e-12)
    assert limits[1, 0] > limits[1, 1]  # y towards the reader and z down: no mirror
    assert limits[2, 0] > limits[2, 1]
    inside = np.vstack([curve(axis, "estimate").T, curve(axis, "corridor"), np.zeros((1, 3))])
    assert (inside >= limits.min(axis=1) - 1e-9).all()
    assert (inside <= limits.max(axis=1) + 1e-9).all()
    corners = np.array(list(itertools.product(*limits))).T
    x, y, _ = proj_transform(*corners, axis.get_proj())
    dots = axis.transData.transform(np.stack([x, y], axis=1))
    across, down = np.ptp(dots, axis=0) / figure.dpi
    assert max(across / 9.2, down / 5.7) == pytest.approx(1.0, abs=0.02)  # the room it has, inches


@pytest.mark.parametrize("corridor_deg", [2.0, 10.0, 60.0])
def test_the_corridor_has_its_angle(approach, corridor_deg):
    lines = curve(of(approach, corridor_deg)[2], "corridor")
    off = np.hypot(lines[:, 1], lines[:, 2])
    np.testing.assert_allclose(off, lines[:, 0] * math.tan(math.radians(corridor_deg)), atol=1e-12)


def test_ellipsoids_are_those_of_the_covariance(drawn):
    view, figure, axis = drawn
    times = magnification(view.places, axis.get_xlim()[1])
    points, far, squares = curve(axis, "3-sigma ellipsoid"), axis.get_xlim()[1], []
    assert f"{times:g} times its size" in str({text.get_text() for text in figure.legends[0].get_texts()})
    assert len(segments(axis, "3-sigma") + segments(axis, "one larger")) == 3 * len(with_room(view.places, APART * far))
    for place in view.places:
        apart = points - place.position_m
        squares.append(np.einsum("ni,ij,nj->n", apart, np.linalg.inv(place.covariance_m2), apart))
    nearest = np.abs(np.sqrt(np.abs(squares)) / (3.0 * times) - 1.0).min(axis=0)
    assert nearest.max() < 1e-9


def test_words_are_whole_apart_and_named_once(drawn):
    _, figure, axis = drawn
    texts = [figure._suptitle, *figure.legends[0].get_texts(), axis.xaxis.label, axis.yaxis.label, axis.zaxis.label]
    for one in (axis.xaxis, axis.yaxis, axis.zaxis):
        low, high = sorted(one.get_view_interval())
        texts += [tick.label1 for tick in one.get_major_ticks() if low <= tick.get_loc() <= high]
    boxes = [(text.get_window_extent(), text.get_text()) for text in texts if text.get_text()]
    assert len(boxes) > 20
    for box, words in boxes:
        assert box.x0 >= figure.bbox.x0, words
        assert box.x1 <= figure.bbox.x1, words
        assert box.y0 >= figure.bbox.y0, words
        assert box.y1 <= figure.bbox.y1, words
    upright = [(box, words) for box, words in boxes if "docking frame, m" not in words and "port, m" not in words]
    for (box, words), (other, second) in itertools.combinations(upright, 2):
        assert not box.overlaps(other), (words, second)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(names) == len(set(names))


def places(*at_and_sizes):
    return [
        Place(
            t_s=float(k),
            position_m=np.array([x, 0.0, 0.0]),
            covariance_m2=np.eye(3) * (size / 3.0) ** 2,
            correlated=True,
        )
        for k, (x, size) in enumerate(at_and_sizes)
    ]


def test_which_ellipsoids_have_room():
    some = places((10.0, 0.1), (9.5, 0.1), (8.9, 0.1), (4.5, 0.1), (4.0, 0.1), (4.0, 0.1))
    assert [place.t_s for place in with_room(some, 1.0)] == [0.0, 2.0, 5.0]
    assert with_room([], 1.0) == []


@pytest.mark.parametrize(
    ("size", "times"), [(1.0, 1.0), (0.3, 1.0), (0.2, 2.0), (0.04, 10.0), (0.007, 50.0), (0.0, 1.0)]
)
def test_magnification_is_1_2_or_5(size, times):
    """As large as USUAL of ten metres at the most, of the one in the middle."""
    assert magnification(places((9.0, 1e3), (5.0, size), (1.0, 0.0)), 10.0) == times
    assert size * times <= max(USUAL * 10.0, size)
    assert USUAL < LARGEST
