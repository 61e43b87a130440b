"""Small arms in the proportions of known ones, as files of a user's own: hinges in a chain, links as rods.

Lengths and joint ranges: Franka Robotics, "Robot and interface specifications" (the Panda's DH parameters); Universal
Robots, "DH parameters for calculations of kinematics and dynamics" (UR5e), with its masses; the others' are round.
"""

from pathlib import Path

PANDA = (  # position in the parent (m), turn about x (deg), range (rad), mass (kg), centre of mass (m)
    ((0, 0, 0.333), 0, (-2.8973, 2.8973), 4.0, (0, 0, -0.1)),
    ((0, 0, 0), -90, (-1.7628, 1.7628), 3.0, (0, -0.1, 0)),
    ((0, -0.316, 0), 90, (-2.8973, 2.8973), 3.0, (0.04, 0, -0.05)),
    ((0.0825, 0, 0), 90, (-3.0718, -0.0698), 3.0, (-0.04, 0.1, 0)),
    ((-0.0825, 0.384, 0), -90, (-2.8973, 2.8973), 2.0, (0, 0, -0.1)),
    ((0, 0, 0), 90, (-0.0175, 3.7525), 1.5, (0.05, 0, 0)),
    ((0.088, 0, 0), 90, (-2.8973, 2.8973), 0.7, (0, 0, 0.06)),
)
UR5E = (
    ((0, 0, 0.1625), 0, (-6.2832, 6.2832), 3.761, (0, 0, 0)),
    ((0, 0, 0), 90, (-6.2832, 6.2832), 8.058, (-0.2125, 0, 0.1)),
    ((-0.425, 0, 0), 0, (-3.1416, 3.1416), 2.846, (-0.2, 0, 0.1)),
    ((-0.3922, 0, 0.1333), 0, (-6.2832, 6.2832), 1.37, (0, 0, 0)),
    ((0, -0.0997, 0), 90, (-6.2832, 6.2832), 1.3, (0, 0, 0)),
    ((0, 0.0996, 0), -90, (-6.2832, 6.2832), 0.365, (0, 0, -0.02)),
)
SPEED = {"panda": (2.175,) * 4 + (2.61,) * 3, "ur5e": (3.1416,) * 6}  # rad/s, from the same sources


def write(folder: Path, name: str, chain) -> str:
    """The chain as an MJCF file; its joints are named as nobody else's are. Returns its path."""
    flange = (0, 0, 0.107) if len(chain) == 7 else (0, 0, 0)
    inner = f'<site name="attachment_site" pos="{flange[0]} {flange[1]} {flange[2]}"/>'
    for i, (pos, turn, span, mass, com) in reversed(list(enumerate(chain))):
        told = " ".join(map(str, pos))
        inner = f"""<body name="part{i}" pos="{told}" euler="{turn} 0 0">
          <inertial mass="{mass}" pos="{" ".join(map(str, com))}" diaginertia="0.03 0.03 0.02"/>
          <joint name="axis{i}" axis="0 0 1" range="{span[0]} {span[1]}" armature="0.05"/>
          <geom type="sphere" size="0.03" mass="0" contype="0" conaffinity="0"/>{inner}</body>"""
    file = folder / f"{name}.xml"
    text = f"""<mujoco><compiler autolimits="true" eulerseq="XYZ"/><option/><worldbody><light pos="0 0 2"/>
      <body name="foot"><inertial mass="5" pos="0 0 0" diaginertia="0.1 0.1 0.1"/>{inner}</body></worldbody></mujoco>"""
    file.write_text(
        text.replace('<compiler autolimits="true"', '<compiler autolimits="true" angle="radian"')
        .replace('euler="90 0 0"', 'quat="1 1 0 0"')
        .replace('euler="-90 0 0"', 'quat="1 -1 0 0"')
        .replace('euler="0 0 0"', "")
    )
    return str(file)
