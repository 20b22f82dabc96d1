"""No installed dependency has a published vulnerability, as far as the index of packages can be asked (pip-audit)."""

import importlib.util
import json
import subprocess
import sys
import sysconfig

import pytest


@pytest.mark.messageless
def test_none_is_known():
    if importlib.util.find_spec("pip_audit") is None:
        pytest.skip("pip-audit is not installed (it comes with the extra `dev`)")
    command = [sys.executable, "-m", "pip_audit", "--path", sysconfig.get_path("purelib"), "--skip-editable"]
    command += ["--format", "json", "--progress-spinner", "off", "--timeout", "5"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    except subprocess.TimeoutExpired:
        pytest.skip("the index of packages did not answer pip-audit within two minutes")
    if not done.stdout.strip():
        pytest.skip(f"pip-audit could not ask the index: {done.stderr.strip().splitlines()[-1:]}")
    packages = json.loads(done.stdout)["dependencies"]
    told = [package for package in packages if "vulns" in package]
    known = [f"{package['name']} {package['version']}: {entry['id']}" for package in told for entry in package["vulns"]]
    assert known == [], "update what pip-audit names"
    if not told:
        pytest.skip(f"the index has no record of vulnerabilities of any of {len(packages)} packages")
