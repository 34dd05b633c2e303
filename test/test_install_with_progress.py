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


@pytest.fixture
def pip(module, tmp_path):
    return module.Pip(tmp_path / "log")


def test_it_says_what_pip_does(pip):
    pip.hear("Collecting numba<0.70,>=0.60\n")
    pip.hear("  Downloading numba-0.62.1-cp311-manylinux.whl (3.8 MB)\n".strip())
    assert pip.progress(0) == "fetches numba, 3.8 MB; 1 package so far"
    pip.hear("Installing collected packages: pytz, numpy, numba\n")
    assert pip.progress(2) == "unpacks: 2 of 3 packages"
    pip.hear("\n")
    assert pip.progress(7) == "unpacks: 3 of 3 packages"
    assert pip.progress(1) == "unpacks: 3 of 3 packages"  # it never goes back


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


def test_success_is_quiet(tmp_path):
    process = run(tmp_path, "print('Collecting a')")
    out, err = process.communicate(timeout=300.0)
    assert process.returncode == 0
    assert out.splitlines()[0] == "installing x"
    assert "done after" in out
    assert err == ""
    assert (tmp_path / "log").read_text() == "Collecting a\n"


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
