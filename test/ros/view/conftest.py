"""Says at the end that the browser was left out, where it was."""

from helpers.browser import chromium


def pytest_terminal_summary(terminalreporter):
    left_out = [
        report.nodeid
        for report in terminalreporter.stats.get("skipped", [])
        if "test_browser" in report.nodeid
    ]
    if left_out and chromium() is None:
        terminalreporter.section("LEFT OUT: tests in the browser", "!", red=True, bold=True)
        for name in left_out:
            terminalreporter.write_line(name, red=True)
        terminalreporter.write_line("Chromium is missing: apt-get install chromium", red=True)
