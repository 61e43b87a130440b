"""Write files of a small example arm: two hinges, a gripper's finger, an existing mesh and a missing one."""

from __future__ import annotations

import struct
from pathlib import Path

CORNERS = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))  # m, corners of a tetrahedron
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))

LINK = """  <link name="{0}">
    <inertial><origin xyz="0 0 0.2" rpy="0 0 0"/><mass value="2"/>
      <inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="{1}" scale="1 1 1"/></geometry></visual>
    <collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
  </link>
"""
JOINT = """  <joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0 0 0.4" rpy="0 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="3"/></joint>
"""
MJCF = """<mujoco model="small">
  <compiler angle="radian" meshdir="."/>
  <size memory="1M"/>
  <asset><mesh name="skin" file="skin.stl"/><mesh name="gone" file="gone.stl"/></asset>
  <include file="more.xml"/>
  <worldbody>
    <body name="upper"><inertial pos="0 0 0.2" mass="2" diaginertia="0.03 0.03 0.01"/>
      <joint name="shoulder" axis="0 1 0" range="-2 2" damping="0.1"/>
      <geom type="mesh" mesh="skin" mass="0"/><geom type="mesh" mesh="gone"/>
      <body name="lower" pos="0 0 0.4"><inertial pos="0 0 0.2" mass="1" diaginertia="0.02 0.02 0.01"/>
        <joint name="elbow" axis="0 1 0" range="-2 2"/>
        <replicate count="3" offset="0 0 0.1"><geom size="0.02"/></replicate>
        <body name="finger" pos="0 0 0.4"><inertial pos="0 0 0" mass="0.1" diaginertia="0.001 0.001 0.001"/>
          <joint name="slide" type="slide" range="0 0.04"/><site name="tool0"/></body></body></body>
  </worldbody>
  <actuator><motor name="m" joint="shoulder" gear="10" ctrlrange="-2 2"/></actuator>
</mujoco>
"""


def write_urdf(folder: Path) -> Path:
    """Write small.urdf and its mesh; return the path of small.urdf."""
    _stl(folder)
    links = LINK.format("upper", "skin.stl") + LINK.format("lower", "package://gone/gone.stl")
    links += LINK.format("finger", "gone.dae")
    joints = JOINT.format("shoulder", "revolute", "base", "upper") + JOINT.format("elbow", "revolute", "upper", "lower")
    joints += JOINT.format("slide", "prismatic", "lower", "finger")
    text = f'<?xml version="1.0"?>\n<robot name="small">\n  <link name="base"/>\n{links}{joints}</robot>\n'
    (folder / "small.urdf").write_text(text, encoding="utf-8")
    return folder / "small.urdf"


def write_mjcf(folder: Path) -> Path:
    """Write small.xml, the file that it includes and its mesh; return the path of small.xml."""
    _stl(folder)
    (folder / "more.xml").write_text('<mujoco><option gravity="0 0 -9.81"/></mujoco>\n', encoding="utf-8")
    (folder / "small.xml").write_text(MJCF, encoding="utf-8")
    return folder / "small.xml"


def _stl(folder: Path) -> None:
    """Write skin.stl, a tetrahedron, as a binary STL without normals."""
    triangles = (struct.pack("<12fH", 0, 0, 0, *(x for i in face for x in CORNERS[i]), 0) for face in FACES)
    (folder / "skin.stl").write_bytes(bytes(80) + struct.pack("<I", len(FACES)) + b"".join(triangles))
