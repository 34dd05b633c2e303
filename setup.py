"""Installs under pip and under colcon alike."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "placement_planner_ros"

EXECUTABLES = (
    "placement_planner",
    "placement_demo",
    "placement_scene",
    "placement_check_robot",
    "placement_view",
)

# The planner as a library.
CORE = [
    "coal>=3.0,<4",
    "filelock>=3.12,<5",
    "joblib>=1.3,<2",
    "numba>=0.60,<0.70",
    "numpy>=1.26,<3",
    "pin>=3.4,<5",
    "pycollada>=0.7,<0.10",
    "scipy>=1.12,<2",
    "toppra>=0.6,<0.7",
    "trimesh>=4.4,<6",
]

# ROS 2 Jazzy as wheels, which exist for x86-64 only. Elsewhere, and wherever a Jazzy is sourced,
# rclpy and the messages come from there.
ROS_WHEELS = [
    "ros-jazzy-common-interfaces>=5.3,<6",
    "ros-jazzy-rclpy>=7.1.6,<7.2",
    "ros-rclpy[fastrtps]>=7.1.6,<7.2",
]

PICTURES = ["matplotlib>=3.8,<4", "pillow>=10.1,<14"]
YAML = ["PyYAML>=6,<7"]

ROS = [*(f'{name} ; platform_machine == "x86_64"' for name in ROS_WHEELS), *PICTURES, *YAML]

# What `python -m benchmarks` needs in a checkout.
BENCHMARKS = [
    *PICTURES,
    "ompl>=2.0,<3",
    "psutil>=5.9,<8",
    *YAML,
]

# Robots to try; 0.4 GB.
ROBOTS = ["example-robot-data>=6,<7"]

# The page in the browser.
VIEW = ["viser>=1.1.1,<2"]

SITE = ["furo>=2024.8,<2027", "myst-parser>=4,<6", "sphinx>=8,<9"]

TEST = [
    *ROS,
    *BENCHMARKS,
    *ROBOTS,
    *VIEW,
    *SITE,
    "colcon-common-extensions>=0.3,<0.4",
    "hypothesis>=6,<7",
    "mujoco>=4,<5",
    "mypy>=1.10,<3",
    "pytest>=8,<10",
    "pytest-xdist>=3.6,<4",
    "ruff>=0.5,<1",
]


def data_files():
    """Index marker, manifest, wrappers for `ros2 run`, and everything under share."""
    share = Path("share") / PACKAGE
    files = {
        Path("share/ament_index/resource_index/packages"): [f"resource/{PACKAGE}"],
        share: ["package.xml"],
        Path("lib") / PACKAGE: [f"resource/executables/{name}" for name in EXECUTABLES],
    }
    for folder in ("config", "launch", "urdf"):
        for path in sorted(Path(folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                files.setdefault(share / path.parent, []).append(str(path))
    return [(str(target), sources) for target, sources in files.items()]


setup(
    name=PACKAGE,
    version="0.3.0",
    description="Anytime placement of a grasped object in clutter, with a certified arm motion",
    long_description=(Path(__file__).resolve().parent / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    author="The placement_planner_ros authors",
    license="MIT",
    keywords=[
        "ROS 2",
        "manipulation",
        "motion planning",
        "placement planning",
        "pick and place",
        "robotics",
    ],
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Developers",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Topic :: Scientific/Engineering",
        "Typing :: Typed",
    ],
    python_requires=">=3.11,<3.13",
    packages=find_packages(include=[f"{PACKAGE}*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=data_files(),
    install_requires=CORE,
    extras_require={
        "ros": ROS,
        "benchmarks": BENCHMARKS,
        "robots": ROBOTS,
        "view": VIEW,
        "site": SITE,
        "test": TEST,
    },
    entry_points={
        "console_scripts": [f"{name} = {PACKAGE}.__main__:{name}" for name in EXECUTABLES],
        "placement_planner_ros.objectives": [
            "toward_front = placement_planner_ros.objectives_example:TowardFront",
        ],
    },
    zip_safe=False,
)
