"""Small quadrupeds drawn otherwise than ours: the MJCF that others might bring."""

from __future__ import annotations

from dataclasses import dataclass

_CORNERS = {"fr": (1, -1), "fl": (1, 1), "rr": (-1, -1), "rl": (-1, 1)}


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """How a quadruped of 15 kg with legs of 0.5 m is written down."""

    order: tuple[str, ...] = ("fl", "rl", "fr", "rr")
    """The legs as the file lists them."""
    sign: float = 1.0
    """Direction in which the joints count."""
    limits: bool = True
    """Whether the joints have ranges."""
    folded: bool = False
    """Whether the file draws the legs stretched to the side and not downwards."""
    damping: float = 0.2
    """Of the joints themselves, N m s/rad."""
    actuator: str = "motor"
    """motor, geared, position, filtered or none."""
    floor: str = '<geom type="plane" size="0 0 1" contype="2" conaffinity="4"/>'
    """What else stands in the world."""
    foot: str = '<geom type="sphere" size="0.03" pos="0 0 -0.25"/>'
    """The end of a shank."""
    extra: str = ""
    """More inside the base."""
    more: str = ""
    """More at the end of the file."""
    assets: str = ""
    """More at its beginning."""
    key: str = ""
    """The keyframes."""


def mjcf(drawing: Drawing) -> str:
    """The text of a quadruped."""
    legs = "".join(_leg(drawing, leg) for leg in drawing.order)
    return f"""<mujoco model="stranger">
  <compiler angle="radian"/>
  {drawing.assets}
  <default>
    <default class="robot">
      <joint armature="0.01" damping="{drawing.damping}"/>
      <default class="robot_seen">
        <geom contype="0" conaffinity="0" group="2"/>
      </default>
      <default class="robot_hit">
        <geom contype="4" conaffinity="2" group="3"/>
        <default class="robot_toe"><geom friction="0.9"/></default>
      </default>
    </default>
  </default>
  <worldbody>
    {drawing.floor}
    <body name="torso" pos="0 0 0.6" childclass="robot">
      <freejoint/>
      <geom class="robot_hit" type="box" size="0.25 0.1 0.06" mass="8"/>
      {legs}{drawing.extra}
    </body>
  </worldbody>
  <actuator>{_actuators(drawing)}</actuator>
  {drawing.key}{drawing.more}
</mujoco>"""


def _leg(drawing: Drawing, leg: str) -> str:
    x, y = _CORNERS[leg]
    sign = drawing.sign

    def joint(name: str, axis: str, low: float, high: float) -> str:
        low, high = sorted((sign * low, sign * high))
        limits = f' range="{low} {high}"' if drawing.limits else ""
        return f'<joint name="{leg}_{name}" axis="{axis}"{limits}/>'

    turned = f' euler="{y * 0.9} 0 0"' if drawing.folded else ""
    return f"""
      <body pos="{0.22 * x} {0.08 * y} 0"{turned}>
        {joint("j0", f"{sign} 0 0", -1.2, 1.2)}
        <geom class="robot_seen" type="cylinder" size="0.04 0.03" mass="0.6"/>
        <body pos="0 {0.06 * y} 0">
          {joint("j1", f"0 {sign} 0", -1.5, 3.0)}
          <geom class="robot_seen" type="capsule" size="0.03"
            fromto="0 0 0 0 0 -0.25" mass="0.8"/>
          <body name="{leg}_shank" pos="0 0 -0.25">
            {joint("j2", f"0 {sign} 0", -2.7, -0.2)}
            <geom class="robot_seen" type="capsule" size="0.015"
              fromto="0 0 0 0 0 -0.25" mass="0.3"/>
            <body childclass="robot_toe">{drawing.foot}<inertial pos="0 0 -0.25"
              mass="0.05" diaginertia="1e-4 1e-4 1e-4"/></body>
          </body>
        </body>
      </body>"""


def _actuators(drawing: Drawing) -> str:
    kinds = {
        "motor": '<motor joint="{}" ctrlrange="-40 40"/>',
        "geared": '<motor joint="{}" ctrlrange="-4 4" gear="10"/>',
        "position": '<position joint="{}" kp="120" kv="2" forcerange="-40 40"/>',
        "filtered": '<position joint="{}" kp="120" kv="2" timeconst="0.05" '
        'forcerange="-40 40"/>',
        "none": "",
    }
    joints = [f"{leg}_j{index}" for index in range(3) for leg in drawing.order]
    return "".join(kinds[drawing.actuator].format(joint) for joint in joints)


def urdf(more: str = "") -> str:
    """A quadruped as a URDF, with `more` in it."""
    parts = [_link("trunk", '<box size="0.44 0.12 0.1"/>', 6.0)]
    for leg, (x, y) in _CORNERS.items():
        hip, thigh, calf, foot = (
            f"{leg}_{n}" for n in ("hip", "thigh", "calf", "foot")
        )
        parts += [
            _link(hip, '<sphere radius="0.01"/>', 0.5),
            _link(thigh, '<box size="0.03 0.03 0.03"/>', 0.8),
            _link(calf, '<box size="0.02 0.02 0.02"/>', 0.2),
            _link(foot, '<sphere radius="0.02"/>', 0.05),
            _joint("trunk", hip, f"{0.2 * x} {0.06 * y} 0", "1 0 0", -0.9, 0.9),
            _joint(hip, thigh, f"0 {0.08 * y} 0", "0 1 0", -1.0, 3.0),
            _joint(thigh, calf, "0 0 -0.2", "0 1 0", -2.6, -0.3),
            _joint(calf, foot, "0 0 -0.2", "0 1 0", 0.0, 0.0),
        ]
    return f'<robot name="stranger">{"".join(parts)}{more}</robot>'


def _link(name: str, shape: str, mass_kg: float) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="{mass_kg}"/><inertia ixx="0.01" '
        'ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
        f"<collision><geometry>{shape}</geometry></collision></link>"
    )


def _joint(
    parent: str, child: str, place: str, axis: str, low: float, high: float
) -> str:
    kind = "revolute" if high > low else "fixed"
    return (
        f'<joint name="{child}_joint" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{place}"/><axis xyz="{axis}"/>'
        f'<limit lower="{low}" upper="{high}" effort="30" velocity="20"/></joint>'
    )
