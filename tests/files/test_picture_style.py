"""What a picture is labelled with: round numbers on every logarithmic axis, labels that hide nothing."""

import itertools

import numpy as np
import pytest

from relnav.files.label_places import free_places
from relnav.files.picture_style import fine_grid, log_ticks, new_figure, plain_decades, plainly


@pytest.mark.parametrize("room", [2, 4, 6])
@pytest.mark.parametrize("decades", [0.25, 0.5, 1.0, 2.5, 6.0, 40.0])
@pytest.mark.parametrize("low", [1e-9, 0.00024, 0.07, 3.3, 9.9e4])
def test_a_logarithmic_axis_has_two_numbers_or_more_and_room_for_them(low, decades, room):
    high = low * 10.0**decades
    found = log_ticks(low, high, room)
    assert found == sorted(set(found))
    assert all(low <= value <= high for value in found)
    assert len(found) <= max(room, 4)
    if decades >= 0.5:
        assert len(found) >= 2
        assert all(len(f"{value:.1e}".partition("e")[0].rstrip("0.")) <= 3 for value in found)


@pytest.mark.parametrize("limits", [(0.0, 1.0), (-1.0, 1.0), (2.0, 2.0), (float("nan"), 1.0)])
def test_where_no_logarithm_is_there_are_none(limits):
    assert log_ticks(*limits, 4) == []


@pytest.mark.parametrize(
    ("value", "digits", "text", "short"),
    [(6.2e-5, 2, "0.000062", "6.2e-5"), (0.001, 15, "0.001", "1e-3"), (30.0, 15, "30", "3e1"), (0.0, 2, "0", "0")],
)
def test_a_number_is_written_plainly_or_with_an_exponent(value, digits, text, short):
    assert plainly(value, digits) == text
    assert plainly(value, digits, exponent=True) == short


@pytest.mark.parametrize("limits", [(2e-6, 0.3), (2e-8, 0.3), (0.5, 3e6)])
def test_numbers_of_an_axis_are_all_written_in_one_way(limits):
    figure = new_figure(3.0, 3.0)
    axis = figure.subplots()
    axis.set_yscale("log")
    axis.set_ylim(*limits)
    plain_decades(axis)
    figure.canvas.draw()
    texts = [text.get_text() for text in axis.get_yticklabels()]
    assert len(texts) >= 3
    assert len({"e" in text for text in texts}) == 1


@pytest.mark.parametrize("limits", [(0.0024, 0.008), (0.0016, 0.0019), (1e-4, 0.13)])
def test_numbers_are_written_as_one_writes_them(limits):
    """Also where an axis spans so little that no power of ten is on it."""
    figure = new_figure(3.0, 1.2)
    axis = figure.subplots()
    axis.semilogy([0.0, 1.0], limits)
    axis.set_ylim(*limits)
    plain_decades(axis)
    fine_grid(axis)
    figure.canvas.draw()
    texts = [text.get_text() for text in axis.get_yticklabels()]
    at = [float(text) for text in texts if text and limits[0] <= float(text) <= limits[1]]
    assert len(at) >= 2
    assert not any("$" in text for text in texts)
    assert axis.get_ylim() == limits


@pytest.fixture
def crowd():
    """Two hundred marks in a square, a third of them in one corner, and labels of two sizes."""
    rng = np.random.default_rng(5)
    marks = np.vstack([rng.uniform(-250.0, 250.0, (130, 2)), rng.uniform(150.0, 250.0, (70, 2))])
    sizes = np.array([[45.0, 8.0], [35.0, 8.0]])[np.arange(60) % 2]
    return marks, list(range(100, 160)), sizes


def test_labels_lie_on_no_mark_and_on_no_other_label(crowd):
    marks, labelled, sizes = crowd
    edge = np.full(2, 260.0)
    places = free_places(marks, 5.0, labelled, sizes, edge)
    boxes = [
        (marks[k] + place[0], marks[k] + place[0] + size)
        for k, size, place in zip(labelled, sizes, places, strict=True)
        if place is not None
    ]
    assert 25 < len(boxes) < 60  # not every one finds room
    assert any(place[1] for place in places if place is not None)
    for low, high in boxes:
        assert (low >= -edge).all()
        assert (high <= edge).all()
        assert not ((marks + 5.0 > low) & (marks - 5.0 < high)).all(axis=1).any()
    for (low, high), (other_low, other_high) in itertools.combinations(boxes, 2):
        assert not ((low < other_high) & (high > other_low)).all()


def test_a_label_with_room_stands_beside_its_mark():
    ((corner, led),) = free_places(np.zeros((1, 2)), 5.0, [0], np.array([[45.0, 8.0]]))
    assert not led
    assert 5.0 < corner[0] < 8.0
