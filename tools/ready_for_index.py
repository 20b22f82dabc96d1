"""Whether a folder of built files can go to a package index; if not, what is missing and where to write it.

    RELNAV_PREBUILD=0 python -m build
    python tools/ready_for_index.py dist     # exit code 0: ready; 1: not ready

Whether the description renders, and what a wheel contains, is left to `twine check --strict` and
`check-wheel-contents`. Here it is checked that the metadata are complete, that sdist and wheels state the same, that an
index takes the wheels' tags, that every declared Python has a wheel, and that the release has its dates and addresses.
"""

import argparse
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

from packaging.metadata import Metadata
from packaging.utils import parse_sdist_filename, parse_wheel_filename

ROOT = Path(__file__).resolve().parents[1]
ADDRESSES = ("Source", "Documentation", "Changelog", "Issues")
"""What an index shows beside the description; `Source` also makes the README's links work there (hatch_build.py)."""
INTO_A_CHECKOUT = re.compile(r"\]\((?!https?:|#)[^)]*\)")


def metadata_of(path: Path) -> Metadata:
    """What a built file says of itself, checked against the standard."""
    if path.suffix == ".whl":
        with zipfile.ZipFile(path) as archive:
            (name,) = [name for name in archive.namelist() if re.fullmatch(r"[^/]+\.dist-info/METADATA", name)]
            return Metadata.from_email(archive.read(name))
    return Metadata.from_email(member_of(path, "PKG-INFO"))


def member_of(sdist: Path, name: str) -> bytes:
    """A file at the top of an sdist."""
    with tarfile.open(sdist) as archive:
        file = archive.extractfile(f"{sdist.name.removesuffix('.tar.gz')}/{name}")
        return file.read() if file else b""


def wrong_in_metadata(said: Metadata, project: dict) -> Iterator[str]:
    """What is missing, or is not what `[project]` of pyproject.toml declares."""
    where = "in [project] of pyproject.toml"
    if str(said.version) != project["version"]:
        yield f"version {said.version}, but {project['version']} {where}: an older build? empty the folder, build again"
    wanted = {
        "summary": said.summary,
        "author": said.author or said.author_email,
        "licence expression": said.license_expression,
        "licence file": said.license_files,
        "classifiers": said.classifiers,
        "required Python": said.requires_python,
    }
    yield from (f"no {what}: state it {where}" for what, value in wanted.items() if not value)
    if set(said.provides_extra or ()) != set(project["optional-dependencies"]):
        yield f"its extras are not those {where}: build again"
    if said.description_content_type != "text/markdown" or not said.description:
        yield "no description in Markdown: hatch_build.py makes it of README.md"
    addresses = said.project_urls or {}
    if (source := addresses.get("Source", "")) not in (said.description or ""):
        yield f"the description has no link to {source}: build from a checkout, an sdist keeps the description it has"
    if links := INTO_A_CHECKOUT.findall(said.description or ""):
        yield f"the description links into a checkout, where an index has nothing: {', '.join(links[:3])}"
    missing = [name for name in ADDRESSES if not addresses.get(name, "").startswith("https://")]
    if missing:
        yield f"no https address of {', '.join(missing)}: write it in [project.urls] of pyproject.toml"


def wrong_in_tags(wheels: list[str], classifiers: list[str]) -> Iterator[str]:
    """Wheels that an index refuses, and Pythons for which there is none."""
    tags = {wheel: parse_wheel_filename(wheel)[3] for wheel in wheels}
    for wheel, its_tags in tags.items():
        if any(tag.platform.startswith("linux_") for tag in its_tags):
            yield (
                f"{wheel}: an index refuses the tag of this machine alone; build with RELNAV_PREBUILD=0, "
                "or give it a manylinux tag (CONTRIBUTING.md, Publishing a release)"
            )
    interpreters = {tag.interpreter for its_tags in tags.values() for tag in its_tags}
    for python in re.findall(r"Python :: 3\.(\d+)", "\n".join(classifiers)):
        if not interpreters & {"py3", f"cp3{python}"}:
            yield f"no wheel for Python 3.{python}: build with RELNAV_PREBUILD=0 for one that serves all of them"


def wrong_in_dates(changelog: str, citation: str, version: str, source: str) -> Iterator[str]:
    """What a release writes into CHANGELOG.md and CITATION.cff."""
    day = r"\d{4}-\d{2}-\d{2}"
    if not re.search(rf"^## {re.escape(version)} \({day}\)$", changelog, re.MULTILINE):
        yield f"CHANGELOG.md: no heading '## {version} (YYYY-MM-DD)' with the day of the release"
    if not re.search(rf"^version: {re.escape(version)}$", citation, re.MULTILINE):
        yield f"CITATION.cff: its version is not {version}"
    if not re.search(rf"^date-released: [\"']?{day}[\"']?$", citation, re.MULTILINE):
        yield "CITATION.cff: no 'date-released: YYYY-MM-DD'"
    if source and f"repository-code: {source}" not in citation.replace('"', ""):
        yield f"CITATION.cff: no 'repository-code: {source}', the address of [project.urls] Source"


def wrong_by_tools(files: list[Path]) -> Iterator[str]:
    """What the two tools of the trade say; each file is its own line."""
    commands = {"twine": ("check", "--strict", *files)}
    commands["check_wheel_contents"] = tuple(path for path in files if path.suffix == ".whl")
    for module, arguments in commands.items():
        command = [sys.executable, "-m", module, *map(str, arguments)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            yield f"{module}: {(done.stdout + done.stderr).strip()}"


def wrong(folder: Path) -> Iterator[str]:
    """Everything that keeps the files of a folder from an index, one sentence each."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    wheels, sdists = sorted(folder.glob("*.whl")), sorted(folder.glob("*.tar.gz"))
    if len(sdists) != 1 or not wheels:
        yield f"{len(sdists)} sdists and {len(wheels)} wheels, where one sdist and its wheels belong: python -m build"
        return
    (sdist,) = sdists
    files = [sdist, *wheels]
    names = {parse_sdist_filename(sdist.name), *(parse_wheel_filename(path.name)[:2] for path in wheels)}
    said = {path: metadata_of(path) for path in files}
    if len(names) != 1 or len({str(metadata.as_rfc822()) for metadata in said.values()}) != 1:
        yield "sdist and wheels are not of one build: empty the folder, build again"
    first = said[sdist]
    yield from wrong_in_metadata(first, project)
    yield from wrong_in_tags([path.name for path in wheels], project["classifiers"])
    texts = (member_of(sdist, name).decode() for name in ("CHANGELOG.md", "CITATION.cff"))
    yield from wrong_in_dates(*texts, str(first.version), (first.project_urls or {}).get("Source", ""))
    yield from wrong_by_tools(files)


def main() -> None:
    """Look, and say."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="with the sdist and the wheels, as python -m build makes them")
    folder = parser.parse_args().folder
    found = [*wrong(folder)]
    for sentence in found:
        print(f"- {sentence}")
    print(f"{folder}: {'not ready for an index' if found else 'ready for an index'}")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
