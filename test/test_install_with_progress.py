"""What `make` says while pip is at work, and where it fails."""

import os
import signal
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

FILE = Path(__file__).parents[1] / "install_with_progress.py"


@pytest.fixture(scope="module")
def module():
    spec = spec_from_file_location("install_with_progress", FILE)
    made = module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


@pytest.mark.parametrize(
    ("said", "remedy"),
    [
        ("ERROR: Could not install: [Errno 28] No space left on device", "room on the disk"),
        ("NewConnectionError(': Failed to establish a new connection')", "PyPI is not reached"),
        ("ERROR: No matching distribution found for ros-jazzy-rclpy", "PYTHON=python3.12"),
        ("something unheard of", "read "),
    ],
)
def test_it_says_what_to_try(module, tmp_path, said, remedy):
    log = tmp_path / "log"
    log.write_text(said)
    assert remedy in module.Pip(log).remedy()


def run(tmp_path, script):
    """Whatever Python script in place of pip."""
    command = [sys.executable, str(FILE), str(tmp_path / "log"), "installing x"]
    return subprocess.Popen(
        [*command, sys.executable, "-uc", script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # what a shell starts in the background ignores it, and so does what that starts
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def test_a_failure_is_shown_with_its_last_words(tmp_path):
    script = "print('ERROR: [Errno 28] No space left on device'); raise SystemExit(1)"
    process = run(tmp_path, script)
    out, err = process.communicate(timeout=300.0)
    assert process.returncode == 1
    assert "installing x" in out
    assert "No space left" in err
    assert "what to try: make room" in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_it_ends_pip_and_says_so(tmp_path, number):
    script = "import os, time; print(os.getpid(), flush=True); time.sleep(600)"
    process = run(tmp_path, script)
    log = tmp_path / "log"
    while not (log.exists() and log.read_text().strip()):
        assert process.poll() is None
    process.send_signal(number)
    _, err = process.communicate(timeout=300.0)
    assert process.returncode == 130
    assert "interrupted" in err
    with pytest.raises(ProcessLookupError):
        os.kill(int(log.read_text()), 0)


def test_a_command_that_is_not_there_is_named(tmp_path):
    command = [sys.executable, str(FILE), str(tmp_path / "log"), "installing x", "/nowhere/python"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "/nowhere/python" in done.stderr
