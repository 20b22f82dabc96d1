"""Every message of docs/troubleshooting.md appears when its cause is there, and every cause here is on the page."""

import math
import os
import random
import re
from pathlib import Path

import pytest

import relnav
import relnav.cli

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
MESSAGES = re.findall(r"^\| `(.*?)` \|", PAGE, re.MULTILINE)
PSD = "three_beacon_psd"
WORDS_OF_THE_COMPILER = "compiling for this processor"  # to make it appear takes a minute: held to the source below


def pattern(message: str) -> re.Pattern[str]:
    return re.compile(".*".join(re.escape(part.strip()) for part in message.split("...")), re.DOTALL)


def logs() -> dict[str, str]:
    """Twenty images of the example, and what can be wrong with them."""
    head, *rows = (ROOT / "examples" / "basilisk_approach" / "vbar_log.csv").read_text().splitlines()[:21]
    cells = [row.split(",") for row in rows]
    rng = random.Random(1)
    none = [[c[0], *[""] * 6, *c[7:]] for c in cells]
    anywhere = [[c[0], *(f"{rng.uniform(-3500, 3500):.1f}" for _ in range(6)), "0", "0", "0"] for c in cells]
    exchanged = [[c[0], *c[3:5], *c[1:3], *c[5:]] for c in cells]

    times = [*(0.1 * k for k in range(50)), *(65.0 + 0.1 * k for k in range(50))]
    moved = [[repr(t), *"-1500,0,1500,0,0,0".replace("1500", "1500" if t < 10.0 else "1875").split(",")] for t in times]
    alike, noise = [], [0.0] * 6
    for k in range(400):
        noise = [0.8 * one + 6.0 * rng.gauss(0.0, 1.0) for one in noise]
        spots = (one + own for one, own in zip((-1500, 0, 1500, 0, 0, 0), noise, strict=True))
        alike.append([repr(0.1 * k), *(f"{spot:.2f}" for spot in spots)])
    steps = [[repr(0.1 * k), *(str(20 * round(x / 20 + k / 8)) for x in (-1500, 0, 1500, 0, 0, 0))] for k in range(50)]
    last = [repr(-0.5 + 1e-3 * math.sin(0.1 * (k // 10))) for k in range(300)]
    seldom = [[repr(0.1 * k), "-1500,0,1500,0,0,0,0.5,-0.5,-0.5", last[k]] for k in range(300)]
    markers = ",".join(["t_s", *(f"spot_{m}_{axis}_px" for m in "abc" for axis in "xy")])
    turned = [[repr(0.1 * k), "469.3,553.7,553.7,553.7,511.5,511.5,0.5,-0.5,0.5,0.5"] for k in range(5)]

    def table(header: str, content: list[list[str]]) -> str:
        return "\n".join([header, *(",".join(row) for row in content)]) + "\n"

    return {
        "good.csv": table(head, cells),
        "none.csv": table(head, none),
        "anywhere.csv": table(head, anywhere),
        "exchanged.csv": table(head, exchanged),
        "alike.csv": table(head.partition(",accel")[0], alike),
        "seldom.csv": table(head.partition(",accel")[0] + "".join(f",q_cam_from_lvlh_{p}" for p in "xyzw"), seldom),
        "steps.csv": table(head.partition(",accel")[0], steps),
        "gap.csv": table(head.partition(",accel")[0], moved),
        "turned.csv": table(markers + "".join(f",q_chaser_from_lvlh_{axis}" for axis in "xyzw"), turned),
        "millimetres.csv": table(head.replace("_um", "_mm"), cells),
        "no_unit.csv": table(head.replace("spot_a_x_um", "spot_a_x"), cells),
        "kilograms.csv": table(head.replace("spot_a_x_um", "spot_a_x_kg"), cells),
        "word.csv": table(head, [*cells[:2], [cells[2][0], "abc", *cells[2][2:]]]),
        "late.csv": table(head + ",image_t_s", [[*c, c[0]] for c in cells]),
        "back.csv": table(head, [cells[0], cells[1], cells[0]]),
        "stars.csv": table("t_s,sensor,v0,v1,v2,v3", [[repr(0.1 * k), "star,0.6,0,0,0.8"] for k in range(12)]),
        "empty.csv": "",
        "header.csv": head + "\n",
        "no_comma.csv": "t_s\n1\n",
        "two_stars.csv": "x_px,y_px\n1,2\n3,4\n",
        "scenario.toml": "[approach]\nspeed = 1.0\n",
        "built.toml": "[as_built]\nby_tolerances = true\n",
    }


def models() -> dict[str, str]:
    text = Path(relnav.load_model(PSD).path).read_text(encoding="utf-8")

    def changed(old: str, new: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return {
        "sure.toml": changed("spot_noise_um = { value = 10.0", "spot_noise_um = { value = 3.0"),
        "unsure.toml": changed("spot_noise_um = { value = 10.0", "spot_noise_um = { value = 40.0"),
        "misspelt.toml": changed("focal_length_mm", "focal_lenght_mm"),
        "degrees.toml": changed("focal_length_mm", "focal_length_deg"),
        "other.toml": changed("focal_length_mm", "x_mm"),
        "negative.toml": changed("value = 50.0", "value = -50.0"),
        "long.toml": changed("value = 50.0", "value = 50e3"),
        "away.toml": changed("value = [0.5, -0.5, -0.5, -0.5]", "value = [-0.5, 0.5, -0.5, -0.5]"),
        "kind.toml": changed('"three_beacon"', '"beacons"'),
        "broken.toml": changed("[sensor]", "[sensor"),
        "exact.toml": text.partition("[tolerances]")[0],
    }


COMMANDS = [
    *(f"filter {log} --model {PSD} --quiet" for log in ("absent.csv", "no_unit.csv", "kilograms.csv", "word.csv")),
    *(f"filter {log} --model {PSD}" for log in ("back.csv", "late.csv", "empty.csv", "header.csv", "no_comma.csv")),
    *(f"filter {log} --model {PSD}" for log in ("none.csv", "anywhere.csv", "exchanged.csv", "millimetres.csv")),
    *(f"filter {log} --model {PSD}" for log in ("gap.csv", "alike.csv", "steps.csv")),
    *(f"filter {log} --model {PSD} --method spots" for log in ("good.csv", "seldom.csv")),
    "filter turned.csv --model three_marker_vision",
    "filter stars.csv --model rendezvous_demo",
    *(f"filter good.csv --model {model}" for model in ("sure.toml", "unsure.toml", "aps_sun", "three_marker_vision")),
    *(f"models {name}.toml" for name in ("misspelt", "degrees", "other", "negative", "long", "away", "kind", "broken")),
    "models three_beacon",
    f"campaign {PSD} --runs 2 --scenario scenario.toml --out flights",
    f"budget {PSD} --set focal=80",
    "filtre",
    f"filter good.csv --model {PSD} --methode spots",
    f"filter good.csv --model {PSD} --out track.docx",
    f"filter good.csv --model {PSD} --plot track.gif",
    f"filter good.csv --model {PSD} --out nowhere/track.csv",
    "budget three_marker_vision --plot budget.png",
    f"filter --follow good.csv --model {PSD} --smooth",
    "campaign exact.toml --runs 2 --scenario built.toml --out flights",
    "stars solve two_stars.csv",
    "stars solve two_stars.csv --model ground_camera",
]


def calls() -> list[str]:
    """What a program is told."""
    model = relnav.load_model(PSD)
    navigator = relnav.Navigator(model)
    seen = [[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]]
    navigator.step(1.0, seen)
    said = []
    for call in (
        lambda: relnav.Navigator(model, method="spot"),
        lambda: navigator.step(2.0, [[0.0, 0.0]]),
        lambda: navigator.step(0.5, seen),
        lambda: navigator.step(2.0, seen, image_t_s=1.5),
    ):
        with pytest.raises(ValueError) as caught:  # noqa: PT011  (its words are what is looked at)
            call()
        said.append(str(caught.value))
    return said


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Everything that was said."""
    import contextlib
    import io

    folder = tmp_path_factory.mktemp("wrong")
    for name, text in {**logs(), **models()}.items():
        (folder / name).write_text(text, encoding="utf-8")
    said = calls()
    with contextlib.chdir(folder):
        for command in COMMANDS:
            both = io.StringIO()
            with contextlib.redirect_stdout(both), contextlib.redirect_stderr(both):
                relnav.cli.run(command.split())
            said.append(both.getvalue())
        both = io.StringIO()
        with contextlib.redirect_stderr(both), contextlib.redirect_stdout(both):
            follow(logs()["good.csv"] + "no row\n" * 100)
        said.append(both.getvalue())
    return said


def follow(text: str) -> None:
    """Follow a log that comes through a pipe."""
    read, write = os.pipe()
    os.write(write, text.encode())
    os.close(write)
    relnav.cli.run(["filter", "--follow", f"/dev/fd/{read}", "--model", PSD, "--out", "track.csv"])
    os.close(read)


@pytest.mark.parametrize("message", [message for message in MESSAGES if WORDS_OF_THE_COMPILER not in message])
def test_a_message_of_the_page_appears(told, message):
    assert any(pattern(message).search(text) for text in told), message


def test_what_is_said_is_on_the_page(told):
    lost = [text for text in told if not any(pattern(message).search(text) for message in MESSAGES)]
    assert lost == []


def test_the_page_was_read():
    assert len(MESSAGES) > 35
    compiling = next(message for message in MESSAGES if WORDS_OF_THE_COMPILER in message)
    assert compiling in (ROOT / "relnav" / "codegen" / "kernel.py").read_text(encoding="utf-8")
