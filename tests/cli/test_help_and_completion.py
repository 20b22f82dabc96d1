"""Help in groups that fits a terminal, suggestions for what is misspelt, and what shells are told to complete."""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import threading
import time

import click
import pytest

import relnav.cli
from relnav.cli.help_groups import GroupedCommand
from relnav.files.model_folders import list_models


def commands():
    """Every command by its words; groups too."""
    found, rest = {}, [((), relnav.cli.root)]
    while rest:
        words, command = rest.pop()
        found[" ".join(words) or "relnav"] = command
        if isinstance(command, click.Group):
            rest += [((*words, name), command.get_command(None, name)) for name in command.list_commands(None)]
    return found


COMMANDS = commands()


def help_of(name):
    arguments = [] if name == "relnav" else name.split()
    context = None
    for info, command in zip(["relnav", *arguments], _path(arguments), strict=True):
        context = click.Context(command, info_name=info, parent=context, **command.context_settings)
    return context.command.get_help(context)


def _path(arguments):
    return [COMMANDS[" ".join(arguments[:k]) or "relnav"] for k in range(len(arguments) + 1)]


def sections(text):
    """Titles of a help page, with the options that stand below each."""
    found, title = {}, ""
    for line in text.partition("  Example: ")[0].splitlines():
        if line and not line.startswith(" ") and line.endswith(":"):
            title = line[:-1]
        elif line.startswith("  -"):
            found.setdefault(title, []).extend(
                word.rstrip(",") for word in line.strip().split("  ")[0].split() if word.startswith("-")
            )
    return found


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_stands_under_a_title_once(name):
    command, text = COMMANDS[name], help_of(name)
    assert max(map(len, text.splitlines())) <= 100
    below = sections(text)
    options = [parameter for parameter in command.params if isinstance(parameter, click.Option)]
    if isinstance(command, GroupedCommand):
        assert "Options" not in below
        assert below["Other"] == ["-h", "--help"]  # every other option belongs to a group
        assert len(below) >= 4
    listed = [word for words in below.values() for word in words]
    for option in options:
        places = [title for title, words in below.items() if set(option.opts) & set(words)]
        assert len(places) == 1, option.opts
        assert places[0] != ""
        assert option.help, option.opts
        assert all(listed.count(word) >= 1 for word in option.opts)


def test_commands_of_many_options_are_in_groups():
    many = {name for name, command in COMMANDS.items() if len(command.params) > 12}
    assert {"filter", "simulate"} <= many
    assert {name for name in many if not isinstance(COMMANDS[name], GroupedCommand)} <= {"campaign", "stars solve"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["fitler"], "did you mean 'filter'?"),
        (["stars", "slove"], "did you mean 'solve'?"),
        (["filter", "LOG", "--modle", "x"], "--model"),
        (["filter", "LOG", "--smoth"], "--smooth"),
        (["report", "LOG", "--capture-degg", "3"], "--capture-deg"),
        (["simulate", "x", "--final-rang", "3"], "--final-range"),
        (["simulate", "three_marker_vison", "--out", "x.csv"], "did you mean 'three_marker_vision'?"),
        (["budget", "three_beacon_pds"], "did you mean 'three_beacon_psd'?"),
        (["report", "LOG", "--model", "three_beacon_pds", "--out", "x.html"], "did you mean 'three_beacon_psd'?"),
    ],
)
def test_what_is_misspelt_gets_a_suggestion(run, short_log, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(*(short_log if argument == "LOG" else argument for argument in arguments))
    assert code == 2
    error = " ".join(err.split())
    if said.startswith("--"):
        error = error.partition("Did you mean")[2]  # click's own words: after them, one or several in quotes
        assert f"No such option '{next(word for word in arguments if word.startswith('--'))}'" in err
    assert re.search(rf"{re.escape(said)}(?![a-z-])", error)


@pytest.fixture
def offered(monkeypatch, capfd):
    """offered(shell, words, incomplete) -> what a shell is told: pairs of type and value."""

    def ask(shell, words, incomplete=""):
        monkeypatch.setenv("_RELNAV_COMPLETE", f"{shell}_complete")
        monkeypatch.setenv("COMP_WORDS", " ".join(["relnav", *words, *([incomplete] if shell != "fish" else [])]))
        monkeypatch.setenv("COMP_CWORD", incomplete if shell == "fish" else str(len(words) + 1))
        assert relnav.cli.run([]) == 0
        lines = capfd.readouterr().out.splitlines()
        if shell == "zsh":  # type, value, help, each on a line
            return list(zip(lines[::3], lines[1::3], strict=True))
        return [tuple(line.split("\t")[0].split(",", 1)) for line in lines]

    return ask


FLOWN = [name for name in list_models() if name.startswith(("three_", "rendezvous"))]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_what_shells_are_told(offered, shell):
    assert offered(shell, [], "fi") == [("plain", "filter")]
    assert offered(shell, ["calibrate"], "ps") == [("plain", "psd")]
    assert offered(shell, ["filter"], "--smo") == [("plain", "--smooth")]
    assert offered(shell, ["filter", "log.csv", "--method"], "s") == [("plain", "spots")]
    assert offered(shell, ["filter", "log.csv", "--model"]) == [("plain", name) for name in FLOWN]
    assert offered(shell, ["simulate"], "aps") == [("plain", "aps_sun")]
    assert offered(shell, ["sun", "measure", "x.csv", "--model"], "b") == [("plain", "birefringent_sun")]
    assert offered(shell, ["filter", "log.csv", "--model"], "my_")[0][0] == "file"
    for words in (["filter"], ["filter", "log.csv", "--out"], ["report", "track.csv", "--out"]):
        assert offered(shell, words, "tr")[0][0] == "file"


BASH = """
eval "$(_RELNAV_COMPLETE=bash_source relnav)"
complete -p relnav
told() { COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=(); _relnav_completion relnav; echo "${COMPREPLY[*]}"; }
told relnav fi
told relnav filter log.csv --model three_marker_vision_
"""


@pytest.fixture
def installed(tmp_path):
    """Environment of a shell that finds relnav, in a home of its own."""
    program = tmp_path / "relnav"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m relnav "$@"\n')
    program.chmod(0o755)
    return os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "HOME": str(tmp_path), "TERM": "xterm"}


def needed(shell):
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell}: apt-get install {shell}")


def test_in_bash_itself(installed):
    """The line of docs/start.md, in a shell."""
    needed("bash")
    done = subprocess.run(
        ["bash", "--norc", "-c", BASH], env=installed, capture_output=True, text=True, check=True, timeout=60
    )
    said, command, model = done.stdout.splitlines()
    assert "_relnav_completion" in said
    assert (command, model) == ("filter", "three_marker_vision_flat")


ZSH = """\
autoload -U compinit && compinit -D -u
eval "$(_RELNAV_COMPLETE=zsh_source relnav)"
written() { print -r -- "$BUFFER" >> written }
zle -N written
bindkey '^X' written
"""


def test_in_zsh_itself(installed, tmp_path):
    """Typed at its prompt, with the tabulator; a key of the test writes down what stands there then."""
    needed("zsh")
    (tmp_path / ".zshrc").write_text(ZSH)
    lines = ["relnav fil\t", "relnav filter log.csv --model three_marker_vision_f\t", "relnav filter log.csv --smo\t"]
    master, slave = os.openpty()
    shell = subprocess.Popen(
        ["zsh", "-i"], stdin=slave, stdout=slave, stderr=slave, cwd=tmp_path, env=installed, start_new_session=True
    )
    os.close(slave)
    threading.Thread(target=_drained, args=(master,), daemon=True).start()
    try:
        written, found = tmp_path / "written", []
        for line in lines:
            os.write(master, f"{line}\x18".encode())  # zsh reads on when a completion is done
            until = time.monotonic() + 60.0
            while len(found) <= lines.index(line) and time.monotonic() < until:
                time.sleep(0.05)
                found = written.read_text().splitlines() if written.exists() else []
            os.write(master, b"\x15")  # the line is emptied
    finally:
        shell.kill()
        shell.wait()
        os.close(master)
    assert [line.split()[-1] for line in found] == ["filter", "three_marker_vision_flat", "--smooth"]


def _drained(terminal):
    with contextlib.suppress(OSError):
        while os.read(terminal, 4096):
            pass


def test_in_fish_itself(installed, tmp_path):
    """The line of docs/start.md; fish says itself what it would offer."""
    needed("fish")
    (tmp_path / ".config" / "fish" / "completions").mkdir(parents=True)
    script = "_RELNAV_COMPLETE=fish_source relnav > ~/.config/fish/completions/relnav.fish"
    asked = ["relnav fil", "relnav filter log.csv --model three_marker_vision_f", "relnav filter log.csv --smo"]
    found = []
    for line in [None, *asked]:
        command = script if line is None else f"complete -C '{line}'"
        done = subprocess.run(
            ["fish", "-c", command], env=installed, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=99
        )
        found += [word.split("\t")[0] for word in done.stdout.splitlines()]
    assert found == ["filter", "three_marker_vision_flat", "--smooth"]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_scripts_of_other_shells(monkeypatch, capfd, shell):
    """They name the program and the variable; run where the shell is at hand."""
    monkeypatch.setenv("_RELNAV_COMPLETE", f"{shell}_source")
    assert relnav.cli.run([]) == 0
    script = capfd.readouterr().out
    assert f"_RELNAV_COMPLETE={shell}_complete" in script
    if shutil.which(shell):
        subprocess.run([shell, "-n", "/dev/stdin"], input=script, text=True, check=True, timeout=60)


def test_further_beacons_are_in_the_help_of_filter():
    text = " ".join(help_of("filter").split())
    assert "spot_d_..., of further beacons (extra_beacons_mm in the model)" in text
