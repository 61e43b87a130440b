"""A bench described by its user's own MJCF file: a small arm on a desk with a printed board and two parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

LINK = (
    '<inertial pos="0 0 {0}" mass="{1}" diaginertia="0.02 0.02 0.008"/>'
    '<joint name="{2}" axis="{3}" range="-2.9 2.9" damping="0.4"/>'
    '<geom type="capsule" size="0.035" fromto="0 0 0 0 0 {4}" rgba="0.85 0.85 0.8 1"/>'
)
BENCH = f"""<mujoco model="lab">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81"/>
  <asset>
    <texture name="squares" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0 0 0" width="64" height="64"/>
    <material name="print" texture="squares" texrepeat="4 3"/>
  </asset>
  <worldbody>
    <light pos="0 -1 2" dir="0.2 0.5 -1" diffuse="0.6 0.6 0.6"/>
    <geom name="floor" type="plane" size="4 4 0.1" pos="0 0 -0.72" rgba="0.4 0.42 0.45 1"/>
    <geom name="desk" type="box" size="0.6 0.6 0.02" pos="0.3 0 -0.02" rgba="0.55 0.42 0.3 1"/>
    <body name="calib_board" pos="0.4 -0.1 0.003" euler="0 0 0.3">
      <geom type="box" size="0.1 0.075 0.003" material="print"/></body>
    <body name="parcel" pos="0.47 0.1 0.04" euler="0 0 0.5">
      <freejoint/><geom type="box" size="0.05 0.035 0.04" rgba="0.2 0.45 0.7 1"/></body>
    <body name="tin" pos="0.33 0.12 0.03"><geom type="cylinder" size="0.03 0.03" rgba="0.75 0.2 0.2 1"/></body>
    <body name="base_link">
      <geom type="cylinder" size="0.06 0.04" pos="0 0 0.04" rgba="0.3 0.3 0.32 1"/>
      <body name="turret" pos="0 0 0.1">{LINK.format(0.05, 3, "waist", "0 0 1", 0.1)}
        <body name="upper" pos="0 0 0.1">{LINK.format(0.15, 2.5, "shoulder", "0 1 0", 0.3)}
          <body name="fore" pos="0 0 0.3">{LINK.format(0.12, 1.6, "elbow", "0 1 0", 0.24)}
            <body name="roller" pos="0 0 0.24">{LINK.format(0.03, 0.8, "roll", "0 0 1", 0.05)}
              <body name="wrist" pos="0 0 0.06">{LINK.format(0.03, 0.6, "pitch", "0 1 0", 0.05)}
                <body name="hand" pos="0 0 0.06">{LINK.format(0.02, 0.3, "twist", "0 0 1", 0.03)}
                  <site name="flange" pos="0 0 0.03"/>
                  <camera name="eye_in_hand" pos="0.06 0 0.02" xyaxes="0 1 0 1 0 0" fovy="58" resolution="200 150"/>
                </body></body></body></body></body></body></body>
    <camera name="tripod" pos="1.1 -0.5 0.75" xyaxes="0.5 0.8 0 -0.45 0.28 0.85" fovy="42" resolution="200 150"/>
  </worldbody>
</mujoco>
"""
HOME = np.array([0.0, 0.1, 1.45, 0.0, 1.55, 0.0])
SIZES = np.array([0.28, 0.16, 0.2, 0.3, 0.22, 0.5])


def write_bench(folder: Path) -> Path:
    """Writes lab.xml."""
    (folder / "lab.xml").write_text(BENCH, encoding="utf-8")
    return folder / "lab.xml"


def write_motion(folder: Path, name: str, phase: float) -> Path:
    """Writes a table of commands for the arm: the hand moves over the desk for eight seconds."""
    time = np.arange(0, 8, 0.005)
    ease = np.clip(np.minimum(time, 8 - time), 0, 1)[:, None]
    cycles = np.array([2, 3, 2, 1, 3, 2])
    q = HOME + SIZES * ease * np.sin(2 * np.pi * cycles * time[:, None] / 8 + phase * np.arange(6))
    joints = ("waist", "shoulder", "elbow", "roll", "pitch", "twist")
    head = ",".join(["time", *(f"q_cmd.{j}" for j in joints)])
    np.savetxt(folder / name, np.column_stack([time, q]), delimiter=",", header=head, comments="", fmt="%.9g")
    return folder / name
