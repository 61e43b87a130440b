"""An arm as a URDF whose links have masses and no shapes."""


def bare(rng, joints=6):
    """Return a URDF of a chain of `joints` joints with random origins and axes, whose links have no shapes."""
    links = "".join(
        f'<link name="l{i}"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
        for i in range(joints + 1)
    )
    text = ""
    for i in range(joints):
        at = [" ".join(f"{x:.4f}" for x in rng.uniform(-0.3, 0.3, 3)) for _ in range(2)]
        text += f'<joint name="panda_joint{i + 1}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        text += f'<origin xyz="{at[0]}" rpy="{at[1]}"/><axis xyz="0 0 1"/>'
        text += '<limit lower="-2" upper="2" velocity="2" effort="50"/></joint>'
    return f'<robot name="bare">{links}{text}</robot>'
