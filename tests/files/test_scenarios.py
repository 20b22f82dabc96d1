"""Scenario files: values in SI, and one sentence for what is wrong."""

import math

import pytest

import relnav
from relnav.files.scenarios import SECTIONS


def test_the_example(root_of_examples):
    scenario = relnav.load_scenario(root_of_examples / "campaign" / "vbar.toml", {"approach.speed_mm_s": 20.0})
    assert scenario.approach.speed_m_s == 0.02
    assert scenario.spread.velocity_sigma_m_s == (0.005, 0.005, 0.005)
    assert scenario.images.lost_beacon == "b"
    assert scenario.images.dropout == 0.01
    assert scenario.range_edges_m == (4.1, 5.0, 6.0, 7.0, 8.0, 9.5)


def test_defaults():
    scenario = relnav.load_scenario()
    assert scenario == relnav.Scenario()
    assert scenario.range_edges_m == (4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)
    assert scenario.images.lost_for_s == math.inf


def test_every_section_is_read(tmp_path):
    file = tmp_path / "all.toml"
    file.write_text("\n".join(f"[{name}]" for name in SECTIONS))
    assert relnav.load_scenario(file) == relnav.Scenario()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[aproach]", r":1: aproach: unknown section; did you mean \[approach\]\?"),
        ("[approach]\nspeed_m = 1.0", ":2: approach.speed_m: unit 'm' does not fit; write one of speed_m_s"),
        ("[approach]\nspeed_mm_s = -1.0", "speed_m_s must be positive and finite; got -0.001"),
        ("[spread]\nstart_sigma_m = [1.0, 2.0]", "3 values are expected; got \\[1.0, 2.0\\]"),
        ("[spread]\nstart_sigma_m = [-1.0, 2.0, 1.0]", "greater than or equal to 0"),
        ("[images]\ndropout = 1.5", "dropout is a probability, 0 <= dropout < 1; got 1.5"),
        ("[images]\nlost_beacon = 'd'", "images.lost_beacon: input should be 'none', 'a', 'b' or 'c'; got 'd'"),
        ("[images]\nlost_probability = 2.0", "less than or equal to 1; got 2.0"),
        ("[results]\nrange_edges_m = [5.0, 4.0]", "two or more rising ranges; got \\[5.0, 4.0\\]"),
        ("[thrust]\nscale = 0.1", "unknown key; did you mean 'scale_sigma'"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, text, said):
    file = tmp_path / "wrong.toml"
    file.write_text(text)
    with pytest.raises(relnav.ModelError, match=said):
        relnav.load_scenario(file)


def test_no_file_and_no_key(tmp_path):
    with pytest.raises(relnav.UsageError, match="no such scenario file"):
        relnav.load_scenario(tmp_path / "none.toml")
    with pytest.raises(relnav.UsageError, match=r"'thrust\.size' cannot be set: no section has it"):
        relnav.load_scenario(changes={"thrust.size": 1.0})


@pytest.fixture(scope="session")
def root_of_examples():
    from pathlib import Path

    return Path(__file__).parents[2] / "examples"
