"""Frames of spots: what is read, and the one sentence for what cannot be."""

import numpy as np
import pytest

import relnav
from relnav.files.star_frames import read_star_frame

ROWS = [f"{10 * k - 45},{7 * k - 30},{1000 - k}" for k in range(10)]


@pytest.fixture
def write(tmp_path):
    def run(text):
        path = tmp_path / "frame.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return run


def test_a_frame(write):
    frame = read_star_frame(write("# a comment\nid,y_px,x_px,flux\n\na,1,2,30\nb,3.5,-4,20\n"))
    np.testing.assert_array_equal(frame.spots_px, [[2.0, 1.0], [-4.0, 3.5]])
    np.testing.assert_array_equal(frame.flux, [30.0, 20.0])
    assert frame.magnitude is None


def test_magnitudes_and_neither(write):
    assert read_star_frame(write("x_px,y_px,magnitude\n1,2,3\n")).magnitude == pytest.approx([3.0])
    plain = read_star_frame(write("x_px,y_px\n1,2\n"))
    assert plain.flux is None
    assert plain.magnitude is None


def test_a_frame_without_spots(write):
    assert read_star_frame(write("x_px,y_px,flux\n")).spots_px.shape == (0, 2)


def test_the_centre_can_be_named(write):
    frame = read_star_frame(write("x_px,y_px\n512,384\n"), (512.0, 384.0))
    np.testing.assert_array_equal(frame.spots_px, [[0.0, 0.0]])


NOISE = "x_px,y_px,flux,sigma_x_px,sigma_y_px,correlation\n"


def test_each_spots_noise(write):
    frame = read_star_frame(write(NOISE + "1,2,30,0.3,0.4,0.5\n3,4,20,0.1,0.2,0\n"), residual_px=0.1)
    np.testing.assert_allclose(frame.covariance_px2, [[[0.1, 0.06], [0.06, 0.17]], [[0.02, 0.0], [0.0, 0.05]]])
    np.testing.assert_array_equal(frame.flux, [30.0, 20.0])
    assert read_star_frame(write(NOISE + "1,2,30,0,0,5\n")).covariance_px2 is None


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,2,30,0.1,0,0", ":2: sigma_x_px 0.1, sigma_y_px 0, correlation 0: sigmas are 1e-06 px or more"),
        ("1,2,30,0.1,0.1,1", ":2: sigma_x_px 0.1, sigma_y_px 0.1, correlation 1: sigmas"),
        ("1,2,30,1e31,0.1,0", ":2: sigma_x_px 1e\\+31"),
        ("1,2,30,0.1,,0", ":2: column 'sigma_y_px' is empty"),
    ],
)
def test_noise_that_is_none(write, row, message):
    with pytest.raises(relnav.InputError, match=message):
        read_star_frame(write(f"{NOISE}{row}\n"), residual_px=0.0)


def test_noise_that_is_not_there(write):
    with pytest.raises(relnav.InputError, match="column 'sigma_x_px' is missing"):
        read_star_frame(write("x_px,y_px\n1,2\n"), residual_px=0.0)


BAD = {
    "empty": ("", ": the file is empty; a header line and one row"),
    "binary": (b"\xff\xfe\x00", ": not a text file in UTF-8"),
    "semicolons": ("x_px;y_px\n1;2\n", ":1: cells separated by commas are expected in the header; got ';'"),
    "no x": ("x,y_px,flux\n1,2,3\n", ":1: column 'x_px' is missing; the columns are x, y_px, flux; is it 'x'?"),
    "twice": ("x_px,y_px,x_px\n1,2,3\n", ":1: column 'x_px' stands twice; keep one"),
    "both": ("x_px,y_px,flux,magnitude\n1,2,3,4\n", ":1: columns 'flux' and 'magnitude' say the same; keep one"),
    "short": ("x_px,y_px,flux\n1,2\n", ":2: 3 cells are expected as in the header; got 2"),
    "text": ("x_px,y_px,flux\n1,two,3\n", ":2: column 'y_px': 'two' is not a number"),
    "underscore": ("x_px,y_px\n1_0,2\n", ":2: column 'x_px': '1_0' is not a number"),
    "nan": (
        "x_px,y_px,flux\n1,2,3\n1,nan,3\n",
        ":3: column 'y_px' is empty or NaN; leave a spot that was not measured out",
    ),
    "infinite": ("x_px,y_px,flux\n1,2,inf\n", ":2: column 'flux' is infinite; leave a spot"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read(write, name):
    text, message = BAD[name]
    path = write(text)
    with pytest.raises(relnav.InputError) as caught:
        read_star_frame(path)
    assert str(caught.value).startswith(f"{path}{message}")
    assert "\n" not in str(caught.value)


def test_a_log_of_frames_is_no_frame(write):
    rows = "\n".join(f"{k // 20},{10 * (k % 20) - 95},{7 * (k % 20) - 66}" for k in range(20_001))
    with pytest.raises(relnav.InputError, match="more than 20000 rows; one frame is expected; of a log of frames keep"):
        read_star_frame(write(f"t_s,x_px,y_px\n{rows}\n"))


def test_coordinates_from_a_corner_are_refused(write):
    """They would be solved with a boresight half an image off."""
    corner = "x_px,y_px\n" + "\n".join(f"{100 * k},{80 * k}" for k in range(9))
    with pytest.raises(
        relnav.InputError,
        match=r"count from a corner \(up to 800, 640\).*--image-size-px WIDTH HEIGHT.*--centre-px X Y",
    ):
        read_star_frame(write(corner))
    assert len(read_star_frame(write(corner), (400.0, 320.0)).spots_px) == 9
