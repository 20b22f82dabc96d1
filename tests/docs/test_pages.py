"""Pages can be read as they stand: what they name exists."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md"), ROOT / "models" / "README.md"])
TUTORIALS = {
    "filter_your_log",
    "close_a_loop",
    "your_own_sensor",
    "your_own_measurement",
    "compare_with_a_paper",
    "design_a_beacon_pattern",
    "night_sky_to_attitude",
    "calibrate_a_sun_sensor",
    "one_vehicle",
    "fly_a_campaign",
}
FOLDERS = ("relnav", "tests", "benchmarks", "examples", "models", "docs", "tools")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_that_are_named_exist(page):
    text = page.read_text(encoding="utf-8")
    named = re.findall(rf"(?<![\w/.])((?:{'|'.join(FOLDERS)})/[\w/.-]+\.(?:py|md|toml|csv|png))\b", text)
    linked = [link for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text) if not link.startswith("http")]
    wanted = {ROOT / name for name in named} | {page.parent / link for link in linked}
    gone = sorted(str(path) for path in wanted if not path.exists() and "NAME" not in str(path))
    assert gone == []


def test_files_that_the_architecture_names_exist():
    """There they are named from `relnav/` on, or from the folder that was named just before."""
    text = re.sub(r"^```.*?^```", "", (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8"), flags=re.M | re.S)
    named = {name for name in re.findall(r"`([\w/]+(?:\.py|/))`", text) if "NAME" not in name}
    there = {f"/{path.relative_to(ROOT).as_posix()}{'/' * path.is_dir()}" for path in ROOT.rglob("*")}
    assert len(named) > 50
    assert [name for name in sorted(named) if not any(path.endswith(f"/{name}") for path in there)] == []


def test_every_tutorial_has_its_script():
    scripts = {path.stem for path in (ROOT / "examples").glob("*.py")}
    tutorials = {path.stem for path in (ROOT / "docs" / "tutorials").glob("*.md")} - {"index"}
    assert scripts == tutorials == TUTORIALS
    script = (ROOT / "examples" / "close_a_loop.py").read_text(encoding="utf-8")
    assert len(script.splitlines()) <= 40
    assert "acceleration_m_s2=command" in script


def test_every_decision_has_its_rejected_option_and_its_price():
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    decisions = text.partition("\n## Decisions\n")[2].partition("\n## ")[0].strip().split("\n\n")
    assert len(decisions) > 50
    for decision in decisions:
        assert decision.startswith("**")
        assert "Rejected: " in decision.replace("\n", " "), decision[:80]
        assert "Price: " in decision.replace("\n", " "), decision[:80]


def test_the_glossary_has_the_words_of_the_field():
    terms = re.findall(r"^(\S.*)\n: ", (ROOT / "docs" / "words.md").read_text(encoding="utf-8"), re.MULTILINE)
    found = {word for term in terms for word in re.split(r", ", term)}
    assert len(found) > 50
    assert {"NEES", "NIS", "V-bar", "H-bar", "R-bar", "lvlh_ccsds", "PSD", "fix", "spot", "invariants", "gate"} <= found
    assert {"port", "corridor", "K-vector", "ambiguity", "considered error", "lasting error"} <= found
    assert {"protection level", "requirement"} <= found


def test_every_claim_and_reference_is_in_the_report():
    """What `benchmarks/validation.py` wrote into the page is not behind the models and the tests."""
    import relnav

    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    report = page.partition("<!-- validation: claims -->")[2]
    for name in ("three_beacon_psd", "dual_field_star", "aps_sun", "three_marker_vision", "birefringent_sun"):
        _, _, after = report.partition(f"`relnav accuracy {name} --runs ")
        section = after.split("###")[0]
        for claim in relnav.load_published(name).claims:
            assert re.search(rf"\| {re.escape(claim.quantity)} \|.*\| {claim.value:.4g} {claim.unit} ", section), claim
    for path in (ROOT / "tests").rglob("test_*.py"):
        if re.search(r"^def test_\w+\([^)]*\boutside\b", path.read_text(encoding="utf-8"), re.MULTILINE):
            assert f"`{path.relative_to(ROOT)}`" in page, path


REFERENCES = (
    "Vallado",
    "Curtis",
    "Orekit",
    "tudat",
    "Yamanaka and Ankersen",
    "Basilisk",
    "PoseLib p3p",
    "OpenCV SOLVEPNP_P3P",
    "ERFA",
    "astropy",
    "Berreman",
    "another camera's sky",
)


@pytest.mark.parametrize("name", REFERENCES)
def test_the_report_compares_with(name):
    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    rows = page.partition("<!-- validation: references -->")[2].partition("<!-- validation: end -->")[0].splitlines()
    assert any(name in row.split(" | ")[0] for row in rows)


def test_a_paper_has_one_year_everywhere():
    """Cai et al. is dated by what our text of it says, 1996, in pages, models, sources and the citation alike."""
    files = [*PAGES, *(ROOT / "relnav").rglob("*.py"), *(ROOT / "models").rglob("*.toml")]
    said = {
        year: path
        for path in files
        for year in re.findall(r"\bCai\b[^()\n]{0,60}\((\d{4})\)", path.read_text(encoding="utf-8"))
    }
    assert list(said) == ["1996"], said
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^ +year: (\d+)$", citation, re.MULTILINE) == ["1996"]


def test_figures_show_what_the_package_says(script):
    """The page says 5.56 deg for 5 deg at 6.5 m; the figure's function is what it is drawn by."""
    figures = script("docs/figures.py")
    assert figures.printed_error_deg(6.5) == pytest.approx(0.56, abs=0.005)
    for name in figures.FIGURES:
        assert [path.name for path in (ROOT / "docs").rglob(f"{name}.png")] == [f"{name}.png"]
