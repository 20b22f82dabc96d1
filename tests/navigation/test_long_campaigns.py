"""The campaigns that fly what these tests fly, with more runs, find what they call: a flight or two of each."""

import importlib.util
from pathlib import Path

import pytest

NAVIGATION = Path(__file__).parent


@pytest.mark.parametrize("what", ["faults", "inertia"])
def test_of_target_attitudes(script, capsys, what):
    campaign = script("benchmarks/target_attitude.py")
    getattr(campaign, what)(2)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == {"faults": 2 * (2 + 5), "inertia": len(campaign.MOMENTS_OFF) + 1}[what]
    assert all("2 runs" in line or "1 runs" in line or "taken for linear" in line for line in lines)


@pytest.mark.parametrize("what", ["faults", "flat", "near", "long", "built", "healthy"])
def test_of_markers(script, capsys, what):
    campaign = script("benchmarks/marker_faults.py")
    assert set(campaign.KINDS) == {"faults", "flat", "near", "long", "built", "healthy"}
    spec = importlib.util.spec_from_file_location("honesty", NAVIGATION / "test_pose_honesty.py")
    tests = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tests)
    campaign.KINDS[what](tests, 1, 50000)
    assert "relied on" in capsys.readouterr().out
