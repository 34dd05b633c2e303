"""Which links are not checked against each other where no SRDF says so."""

from placement_planner_ros.core.robot.allowed_pairs import srdf_line
from placement_planner_ros.core.robot.model import Robot


def link(name, *boxes):
    """Boxes: size and origin, each three numbers in words."""
    shapes = "".join(
        f'<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>'
        for size, at in boxes
    )
    return f'<link name="{name}">{shapes}</link>'


def joint(name, parent, child, at="0 0 0.2", limits=(-1.5, 1.5), axis="0 1 0", more=""):
    low, high = limits
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/>'
        f'<limit lower="{low}" upper="{high}" velocity="1" effort="1"/>{more}</joint>'
    )


def robot_of(*elements, srdf=None):
    return Robot.from_urdf(f'<robot name="test">{"".join(elements)}</robot>', srdf=srdf)


STICK = ("0.04 0.04 0.1", "0 0 0.1")


def test_what_overlaps_at_zero_is_left_out_and_told():
    """c reaches 20 mm into a where all is straight, and seldom else."""
    robot = robot_of(
        link("a", ("0.1 0.1 0.1", "0 0 0")),
        link("b"),
        link("bearing", ("0.02 0.02 0.02", "0 0 0.3")),
        link("c", ("0.1 0.1 0.12", "0 0 -0.21")),
        joint("j", "a", "bearing", "0 0 0", axis="0 0 1"),
        joint("fixed", "bearing", "b", "0 0 0.3"),
        joint("k", "b", "c", "0 0 0"),
    )
    assert robot.allowed_pairs["a", "c"] == "Default"
    (said,) = [w for w in robot.warnings if "a and c" in w]
    assert "zero pose" in said


def test_mimic_joints_follow_while_sampling():
    """A tongue between two prongs, on the same axis: only what turns it alone makes them meet."""
    prongs = [("0.01 0.02 0.2", f"{x} 0 0.2") for x in (-0.04, 0.04)]

    def hand(more):
        return robot_of(
            link("palm", ("0.02 0.02 0.02", "0 0 -0.1")),
            link("prongs", *prongs),
            link("tongue", ("0.02 0.02 0.2", "0 0 0.2")),
            joint("a", "palm", "prongs", "0 0 0", limits=(-0.4, 0.4)),
            joint("b", "palm", "tongue", "0 0 0", limits=(-0.4, 0.4), more=more),
        )

    pair = ("prongs", "tongue")
    assert pair not in hand("").allowed_pairs
    assert pair not in hand('<mimic joint="a"/>').allowed_pairs
    assert hand('<mimic joint="a" offset="0.2"/>').allowed_pairs[pair] == "Always"


def test_links_that_an_srdf_misspells_are_named():
    parts = link("lift", STICK), link("base", STICK), joint("j", "base", "lift")
    lines = srdf_line(("base", "lfit")) + srdf_line(("base", "zzz"))
    robot = robot_of(*parts, srdf=f'<robot name="t">{lines}</robot>')
    assert "the SRDF names links that the URDF has not: lfit, zzz" in robot.warnings


def test_a_line_of_an_srdf_says_the_same():
    parts = [link("a", ("0.1 0.1 0.4", "0 0 0.1")), link("b", ("0.1 0.1 0.1", "0 0 0"))]
    robot = robot_of(*parts, joint("j", "a", "b"))
    lines = "".join(srdf_line(*each) for each in robot.allowed_pairs.items())
    again = robot_of(*parts, joint("j", "a", "b"), srdf=f'<robot name="t">{lines}</robot>')
    assert list(again.allowed_pairs) == list(robot.allowed_pairs)
    assert srdf_line(('"a', "b&")).count("&amp;") == 1
