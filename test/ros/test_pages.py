"""The pages on interface and troubles name all there is in the code."""

import re
from pathlib import Path

from helpers.fakes import started, values_of

from placement_planner_ros.client.errors import CLIENT_CODES
from placement_planner_ros.client.status import ENDED
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.sample_goals.remainder import Cause
from placement_planner_ros.ros import node as everything
from placement_planner_ros.ros.run.worker import State

ROOT = Path(__file__).parents[2]
INTERFACE, TROUBLES, CLIENT = (
    (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    for name in ("interface", "troubleshooting", "client")
)
assert everything, "all errors are there once the node is imported"


def answered():
    """Codes that answers are made with, and those of all errors."""
    made = set()
    for path in (ROOT / "placement_planner_ros" / "ros").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        made |= set(re.findall(r'(?:answer|_outcome)\(\s*"([A-Z_]+)"', text))
    errors = [PlacementPlannerError]
    for error in errors:
        made.add(error.code)
        errors += error.__subclasses__()
    return made


def ending():
    """Codes that an ended run may have besides those of errors."""
    worker = ROOT / "placement_planner_ros" / "ros" / "run" / "worker.py"
    quoted = re.findall(r'"([A-Z]+_[A-Z]+)"', worker.read_text(encoding="utf-8"))
    return {*Cause, *quoted}


def test_every_code_is_named():
    for code in answered() | ending():
        assert re.search(rf"\b{code}\b", INTERFACE), code
        # what is no trouble has no row
        assert re.search(rf"^\| {code} \|", TROUBLES, re.M) or code == "NOT_RUNNING", code
    for code in CLIENT_CODES:
        assert code in CLIENT
        assert code in TROUBLES


def test_no_code_is_named_that_does_not_exist():
    known = answered() | ending() | set(CLIENT_CODES)
    for page in (INTERFACE, TROUBLES):
        told = set(re.findall(r"^\| ([A-Z_]{2,}) \|", page, re.M))
        assert told <= known
    listed = INTERFACE.partition("## Codes")[2]
    assert set(re.findall(r"\b(?:[A-Z]+_[A-Z_]+|[A-Z]{6,})\b", listed)) <= known


def test_every_state_is_named():
    shown = INTERFACE.partition("### States")[2].partition("## Services")[0]
    assert set(re.findall(r"^\| `([a-z_]+)` \|", shown, re.M)) == {*State, "state"}
    assert {state.value for state in State} >= ENDED


def test_every_topic_and_service_is_named_with_its_type(bench):
    b = bench()
    offered = b.node.get_publisher_names_and_types_by_node("placement_planner", "/")
    heard = b.node.get_subscriber_names_and_types_by_node("placement_planner", "/")
    topics = dict([*offered, *heard])
    services = {
        name: kinds
        for name, kinds in b.node.get_service_names_and_types_by_node("placement_planner", "/")
        if "rameter" not in name.rpartition("/")[2] and "type_description" not in name
    }
    ours = {n: k for n, k in topics.items() if n not in ("/rosout", "/parameter_events", "/clock")}
    assert len(services) == 8
    assert len(ours) >= 14
    for name, (kind,) in {**ours, **services}.items():
        shown = name.replace("/placement_planner/", "~/")
        shown = shown if name == "/diagnostics" else shown.removeprefix("/")
        row = re.search(rf"^\| `{shown}`.*$", INTERFACE, re.M)
        assert row, shown
        package, _, last = kind.split("/")
        assert f"`{package}/{last}`" in row[0] or f"`{kind}`" in row[0]


def test_no_topic_or_service_is_named_that_does_not_exist(bench):
    node = bench().node
    known = {p.topic_name for p in node.publishers} | {s.topic_name for s in node.subscriptions}
    known |= {s.service_name for s in node.services}
    tables = INTERFACE.partition("## Topics it hears")[2]
    for name in re.findall(r"^\| `([^`]+)`[^|]*\| `[a-z_]+(?:/srv)?/\w+` \|", tables, re.M):
        full = name.replace("~", "placement_planner")
        assert f"/{full.removeprefix('/')}" in known


def test_every_value_of_status_and_solution_is_named(bench):
    b = bench()
    planner = started(b)
    planner.offers.append(0.5)
    b.wait(lambda: b.status().get("solutions") == "1")
    keys = set(b.status()) | set(values_of(b.messages("solution")[-1].status[0]))
    shown = INTERFACE.partition("### Values of `~/solution`")[2]
    for key in keys:
        named = re.sub(r"^(rejected[_.]).*", r"\1…", key)
        assert f"`{named}`" in shown, key
