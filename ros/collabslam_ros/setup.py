"""The ROS 2 package: a node of collabslam, its launch files, parameters and views."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "collabslam_ros"


def shared(folder: str) -> tuple[str, list[str]]:
    """The files of a folder, and where they are installed."""
    return f"share/{NAME}/{folder}", [str(path) for path in sorted(Path(folder).iterdir())]


setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        shared("launch"),
        shared("config"),
        shared("rviz"),
        shared("foxglove"),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="collabslam",
    description="A node of ROS 2 for collabslam",
    license="MIT OR Apache-2.0",
    entry_points={"console_scripts": [f"collabslam_node = {NAME}.node:main"]},
)
