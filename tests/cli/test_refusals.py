"""What commands refuse, and in which words: one line a message that no other test of a command triggers."""

import contextlib
import re
from pathlib import Path

import pytest

import relnav
import relnav.cli

ROOT = Path(__file__).parents[2]
PSD = "three_beacon_psd"


def without(name, *sections):
    """The text of a shipped model without some of its sections."""
    text = Path(relnav.load_model(name).path).read_text(encoding="utf-8")
    for section in sections:
        text, count = re.subn(rf"(?ms)^\[{section}\]\n.*?(?=^\[|\Z)", "", text)
        assert count == 1
    return text


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Logs, grids and models that cannot be used."""
    folder = tmp_path_factory.mktemp("refused")
    log = (ROOT / "examples" / "basilisk_approach" / "vbar_log.csv").read_text().splitlines()[:20]
    unseen = [re.sub(r"^([^,]*)(,[^,]*){6}", r"\1,,,,,,", line) for line in log[1:]]
    sky = [f"{j},{30 * i},{37 * i * i % 500}" for j in range(2) for i in range(20)]
    files = {
        "good.csv": [*log],
        "late.csv": [f"{log[0]},image_t_s", *(f"{line},{line.split(',')[0]}" for line in log[1:])],
        "unseen.csv": [log[0], *unseen],
        "line.csv": ["true_x_um,true_y_um,spot_x_um,spot_y_um", *(f"{i},0,{i + 1},0" for i in range(20))],
        "sun.csv": ["alpha_deg,beta_deg,spot_x_px,spot_y_px", "1,2,3,4"],
        "pairs.csv": ["spot_a_x_px,spot_a_y_px,spot_b_x_px,spot_b_y_px", *(["500,500,520,520"] * 4)],
        "sky.csv": ["t_s,x_px,y_px", *sky],
        "stars.csv": ["x_px,y_px", *(f"{30 * i - 300},{37 * i * i % 500 - 250}" for i in range(20))],
        "long_line.csv": ["t_s," + "x" * 1_100_000],
        "raw.csv": ["t_s,beacon,current_x1_count,current_x2_count,current_y1_count,current_y2_count"],
        "frame.csv": ["# frame = inertial", "t_s,x_m,y_m,z_m"],
        "loose.toml": [without(PSD, "tolerances")],
        "bare.toml": [without(PSD, "tolerances", "detector", "light", "pulses")],
        "markers.toml": [without("three_marker_vision", "tolerances")],
    }
    for name, lines in files.items():
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "bytes.csv").write_bytes(log[0].encode() + b"\n" + b"\xff" * 1_100_000 + b"\n")
    (folder / "flown" / "runs").mkdir(parents=True)
    (folder / "flown" / "runs" / "0.parquet").touch()
    return folder


DAY = "2026-07-02T12:00:00"
REFUSED = {
    "accuracy aps_sun --plot x.png": (2, "--plot draws missions of beacons and vehicles; aps_sun has no picture"),
    f"accuracy {PSD} --faults --plot x.png": (2, "--faults has no picture; leave --plot out"),
    "accuracy loose.toml --faults": (2, "--faults flies a mission of beacons or markers with [tolerances]"),
    f"campaign {PSD} --runs 2 --out good.csv": (2, "good.csv: is a file; a campaign needs a folder of its own"),
    "report good.csv --model three_marker_vision --method spots --out r.html": (2, "--method is for three-beacon mo"),
    f"filter late.csv --follow --model {PSD} --quiet": (2, "of beacons --follow takes them as they come: leave the"),
    "budget aps_sun": (2, "aps_sun: no error budget is known for this kind of sensor"),
    "budget loose.toml": (2, "a budget needs the section [tolerances]"),
    f"budget {PSD} --set pulses.slot_s=1e60": (2, "too large or too small for a budget: pulses.slot_s=1e60"),
    "budget three_marker_vision --plot x.png": (2, "--plot draws budgets of three-beacon missions"),
    "calibrate fold sky.csv --model dual_field_star --velocity-km-s 0 0 0": (3, "none of 2 frames shows both fields"),
    "calibrate fold sky.csv --model dual_field_star --velocity-km-s 1e9 0 0": (2, "--velocity-km-s: velocity_km_s is"),
    "calibrate psd line.csv --target 0": (2, "--target is a length above zero; got 0"),
    "calibrate psd line.csv": (3, "line.csv: the points lie on one line; spread them over the detector"),
    "calibrate sun sun.csv --out s.json --free zero_spot_x_px": (2, "--free is for a birefringent sensor"),
    "calibrate sun pairs.csv --model birefringent_sun --out s.toml --method rays": (2, "--method is for an APS sensor"),
    "calibrate sun pairs.csv --model birefringent_sun --out s.toml": (3, "pairs.csv: some pair of spots has no sun"),
    "campaign aps_sun --runs 2 --out new": (2, "a campaign flies a three_beacon or three_marker mission, or a vehicle"),
    f"campaign {PSD} --runs 2 --out flown": (2, "flown: holds runs but no campaign.json that says of what"),
    f"simulate {PSD} --out l.csv --rate 1e-9": (2, "duration_s times rate_hz must give two epochs or more; got 0"),
    f"simulate {PSD} --out l.csv --distortion 5": (2, "--distortion belongs to --raw: a log of spots has none"),
    "simulate bare.toml --out l.csv --received-power": (2, "--received-power needs [detector] and [light]; model bare"),
    "simulate bare.toml --out l.csv --raw": (2, "model bare has no [detector], [light] and [pulses]: raw logs need"),
    "simulate bare.toml --out l.csv --as-built": (2, "model bare has no [tolerances]: what a built sensor may be like"),
    "simulate markers.toml --out l.csv --as-built": (2, "model markers has no [tolerances]: what a built sensor may"),
    "simulate three_marker_vision --out l.csv --raw": (2, "are for beacon models; three_marker_vision has markers"),
    "simulate rendezvous_demo --out l.csv --truth t.csv --final-range 1000": (2, "0 < final_m < start_m is expected"),
    f"filter good.csv --model {PSD} --smooth --engine filterpy": (2, "filters a file forward alone: leave smoothing"),
    f"filter unseen.csv --model {PSD} --out l.oem --epoch {DAY}": (2, "holds states, and this track has none"),
    f"filter long_line.csv --model {PSD}": (3, "long_line.csv:1: "),
    f"filter bytes.csv --model {PSD}": (3, "bytes.csv:2: "),
    "stars solve stars.csv --focal-px 5000 --epoch 2026.5 --velocity-km-s 1e9 0 0": (2, "--velocity-km-s: velocity"),
}


@pytest.mark.parametrize(("command", "expected"), REFUSED.items())
def test_a_command_says_what_it_refuses(command, expected, folder, run):
    with contextlib.chdir(folder):
        code, _, err = run(*command.split())
    assert code == expected[0], err
    said = " ".join(err.split())
    assert expected[1] in said
    assert "internal error" not in said
