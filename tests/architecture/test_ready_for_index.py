"""What `tools/ready_for_index.py` tells of built files: what keeps them from an index, and that nothing else does."""

import importlib.util
import os
import subprocess
import sys
import tarfile
import tomllib

import pytest
from packaging.metadata import Metadata

URLS = """
[project.urls]
Source = "https://host.invalid/relnav"
Documentation = "https://host.invalid/relnav/docs"
Changelog = "https://host.invalid/relnav/changelog"
Issues = "https://host.invalid/relnav/issues"
"""


@pytest.fixture
def ready(script):
    return script("tools/ready_for_index.py")


@pytest.fixture(scope="module")
def project(root):
    return tomllib.loads((root / "pyproject.toml").read_text())["project"]


def asked(folder, checkout):
    command = [sys.executable, str(checkout / "tools" / "ready_for_index.py"), str(folder)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, cwd=checkout)


def test_a_release_is_ready_once_its_addresses_and_dates_are_written(ready, distributions, project, tmp_path):
    """As the tool says it: of the build as it stands it names these alone; with them written and built, nothing."""
    missing = [name for name in ("twine", "check_wheel_contents") if importlib.util.find_spec(name) is None]
    if missing:
        pytest.skip(f"not installed: {', '.join(missing)}; pip install 'relnav[dev]'")
    (sdist,) = distributions.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    checkout = tmp_path / sdist.name.removesuffix(".tar.gz")
    (checkout / "PKG-INFO").unlink()  # as in a checkout: of an sdist hatchling takes the description from here
    before = asked(distributions, checkout)
    *sentences, verdict = before.stdout.splitlines()
    assert all("project.urls" in said or "CHANGELOG.md" in said or "date-released" in said for said in sentences)
    assert before.returncode == bool(sentences), before.stderr
    assert verdict.endswith("not ready for an index" if sentences else ": ready for an index")

    version = project["version"]
    text = (checkout / "pyproject.toml").read_text()
    if "[project.urls]" not in text:
        (checkout / "pyproject.toml").write_text(text.replace("\n[project.scripts]", f"{URLS}\n[project.scripts]"))
    source = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]["urls"]["Source"]
    changelog = (
        (checkout / "CHANGELOG.md").read_text().replace(f"## {version} (unreleased)", f"## {version} (2026-11-29)")
    )
    (checkout / "CHANGELOG.md").write_text(changelog)
    with (checkout / "CITATION.cff").open("a") as citation:
        citation.write(f'date-released: 2026-11-29\nrepository-code: "{source}"\n')
    pure = os.environ | {"RELNAV_PREBUILD": "0"}
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path / "dist"), str(checkout)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, env=pure)
    assert done.returncode == 0, done.stdout + done.stderr
    after = asked(tmp_path / "dist", checkout)
    assert (after.returncode, after.stderr) == (0, ""), after.stdout
    assert after.stdout.endswith("dist: ready for an index\n")
    (sdist,) = (tmp_path / "dist").glob("*.tar.gz")
    assert f"]({source}/blob/HEAD/docs/start.md)" in ready.metadata_of(sdist).description


@pytest.fixture
def said(project):
    """said(**changes) -> metadata of a complete release, with some fields changed; None leaves one out."""

    def make(**changes):
        fields = {
            "metadata_version": "2.4",
            "name": "relnav",
            "version": project["version"],
            "summary": "what it is",
            "author": "who made it",
            "license_expression": "MIT",
            "license_files": ["LICENSE"],
            "classifiers": ["Typing :: Typed"],
            "requires_python": ">=3.11",
            "provides_extra": sorted(project["optional-dependencies"]),
            "description": "# relnav\n[a](https://host.invalid/b) [c](#c)",
            "description_content_type": "text/markdown",
            "project_urls": dict.fromkeys(("Source", "Documentation", "Changelog", "Issues"), "https://host.invalid"),
        }
        return Metadata.from_raw({name: value for name, value in (fields | changes).items() if value is not None})

    return make


def test_complete_metadata_lack_nothing(ready, said, project):
    assert [*ready.wrong_in_metadata(said(), project)] == []


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"version": "0.0.1"}, "an older build"),
        ({"summary": None}, "no summary"),
        ({"author": None}, "no author"),
        ({"license_expression": None}, "no licence expression"),
        ({"license_files": None}, "no licence file"),
        ({"classifiers": None}, "no classifiers"),
        ({"requires_python": None}, "no required Python"),
        ({"provides_extra": ["parquet"]}, "its extras are not those"),
        ({"description": "# relnav"}, "the description has no link to https://host.invalid"),
        ({"description": None}, "no description in Markdown"),
        ({"description_content_type": "text/plain"}, "no description in Markdown"),
        ({"description": "[start](docs/start.md)"}, "where an index has nothing: ](docs/start.md)"),
        ({"project_urls": {"Source": "https://host.invalid"}}, "no https address of Documentation, Changelog, Issues:"),
        (
            {"project_urls": {"Source": "ftp://host.invalid"}},
            "no https address of Source, Documentation, Changelog, Issues:",
        ),
    ],
)
def test_what_metadata_lack_is_named(ready, said, project, changes, sentence):
    assert any(sentence in found for found in ready.wrong_in_metadata(said(**changes), project))


def test_tags_that_an_index_refuses_and_pythons_without_a_wheel(ready):
    pythons = ["Programming Language :: Python :: 3", *(f"Programming Language :: Python :: 3.{n}" for n in (11, 12))]
    assert [*ready.wrong_in_tags(["relnav-0.1.0-py3-none-any.whl"], pythons)] == []
    many = [f"relnav-0.1.0-cp31{n}-cp31{n}-manylinux_2_28_x86_64.whl" for n in (1, 2)]
    assert [*ready.wrong_in_tags(many, pythons)] == []
    (missing,) = ready.wrong_in_tags(many[:1], pythons)
    assert missing.startswith("no wheel for Python 3.12")
    refused, missing = ready.wrong_in_tags(["relnav-0.1.0-cp311-cp311-linux_x86_64.whl"], pythons)
    assert "an index refuses the tag" in refused


def test_dates_and_the_address_of_a_release(ready):
    changelog = "# Changelog\n\n## 1.2.0 (2026-11-29)\n\n- x\n\n## 1.1.0 (2025-01-01)\n"
    citation = 'version: 1.2.0\ndate-released: "2026-11-29"\nrepository-code: "https://host.invalid/relnav"\n'
    assert [*ready.wrong_in_dates(changelog, citation, "1.2.0", "https://host.invalid/relnav")] == []
    assert [*ready.wrong_in_dates(changelog, citation, "1.2.0", "")] == []
    (found,) = ready.wrong_in_dates(changelog.replace("2026-11-29", "unreleased"), citation, "1.2.0", "")
    assert "no heading '## 1.2.0 (YYYY-MM-DD)'" in found
    (found,) = ready.wrong_in_dates(changelog, citation, "1.1.0", "")
    assert "its version is not 1.1.0" in found
    (found,) = ready.wrong_in_dates(changelog, "version: 1.2.0\n", "1.2.0", "")
    assert "date-released" in found
    (found,) = ready.wrong_in_dates(changelog, citation, "1.2.0", "https://host.invalid/other")
    assert "repository-code: https://host.invalid/other" in found


def test_files_of_two_builds(ready, tmp_path):
    (found,) = ready.wrong(tmp_path)
    assert found.startswith("0 sdists and 0 wheels")
