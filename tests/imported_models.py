"""Robots of the field by their structure: how public models are written, with numbers of our own.

- `write_quad`: MJCF; masses on geoms, pictures in a mesh that is not there, thrust as motors at
  sites of two heights, torque in `gear`, limits in `ctrlrange`.
- `write_one_site`: MJCF; one thrust and moments at one site, so no rotors.
- `write_hexa`: SDF; links and plug-ins of the motors, base in an included file, tilted rotor links.
- `write_urdf_quad`: URDF; rotors as continuous joints by name, the root link with a mass, a
  transmission for a joint.
- `urdf_arm`: URDF; four hinges, products of inertia, package:// meshes, a gripper of two fingers with
  mimic, placeholder efforts.
- `sdf_gripper`: SDF; one hinge and fingers that slide along one line.
- `turning_gripper`: URDF, MJCF or SDF; one hinge and fingers that turn, the second one a mimic, by
  an equality or with mirrored limits; of fingertips that are links of their own.
- `mjcf_arm`: MJCF; six joints, names with a prefix, inertias turned by quaternions, fingers that an
  equality couples, meshes that are not there.
"""

# ruff: noqa: E501

from __future__ import annotations

from pathlib import Path

KF, KM, FASTEST = 9.0e-6, 0.017, 950.0


def write_quad(folder: Path) -> Path:
    """A quadrotor of 1.2 kg with an inertia product."""
    hubs = [(-0.13, -0.17, 0.04), (-0.13, 0.17, 0.04), (0.15, 0.17, 0.09), (0.15, -0.17, 0.09)]
    geoms = "".join(
        f'<geom type="ellipsoid" size=".12 .12 .01" pos="{x} {y} {z}" mass=".2"/>'
        for x, y, z in hubs
    )
    sites = "".join(f'<site name="s{i}" pos="{x} {y} {z}"/>' for i, (x, y, z) in enumerate(hubs))
    motors = "".join(
        f'<motor site="s{i}" gear="0 0 1 0 0 {sign * 0.02}" ctrlrange="0.1 12"/>'
        for i, sign in enumerate((-1, 1, -1, 1))
    )
    return write(
        folder / "quad.xml",
        f"""
<mujoco model="quad"><compiler autolimits="true"/>
  <default><default class="picture"><geom type="mesh" mass="0" contype="0"/></default></default>
  <asset><texture type="2d" file="skin.png"/><material name="skin" texture="skin"/>
    <mesh file="body.obj"/></asset>
  <worldbody><body name="quad" pos="0 0 0.1"><freejoint/>
    <geom class="picture" mesh="body" material="skin"/>
    <geom type="box" size=".1 .05 .03" pos="0.01 0 0.02" mass=".4"/>{geoms}{sites}
  </body></worldbody>
  <actuator>{motors}</actuator>
  <keyframe><key qpos="0 0 .3 1 0 0 0" ctrl="3 3 3 3"/></keyframe>
</mujoco>""",
    )


def write_one_site(folder: Path) -> Path:
    """A quadrotor whose file has no rotors."""
    moments = "".join(
        f'<motor site="at" gear="0 0 0 {gear}" ctrlrange="-1e-5 1e-5"/>'
        for gear in ("-1 0 0", "0 -1 0", "0 0 -1")
    )
    return write(
        folder / "tiny.xml",
        f"""
<mujoco model="tiny"><compiler inertiafromgeom="false" autolimits="true"/>
  <worldbody><body name="tiny"><freejoint/>
    <inertial pos="0 0 0" mass="0.03" diaginertia="2.4e-5 2.4e-5 3.2e-5"/><site name="at"/>
  </body></worldbody>
  <actuator><motor site="at" gear="0 0 1 0 0 0" ctrlrange="0 0.4"/>{moments}</actuator>
</mujoco>""",
    )


def inertial(tag: str, mass: float, xyz: str, terms: dict[str, float]) -> str:
    """The <inertial> of a link in SDF (`tag` "sdf") or URDF."""
    if tag == "sdf":
        rows = "".join(f"<{key}>{value}</{key}>" for key, value in terms.items())
        return (
            f"<inertial><pose>{xyz} 0.1 0.2 0.3</pose><mass>{mass}</mass>"
            f"<inertia>{rows}</inertia></inertial>"
        )
    rows = " ".join(f'{key}="{value}"' for key, value in terms.items())
    return (
        f'<inertial><origin xyz="{xyz}" rpy="0.1 0.2 0.3"/><mass value="{mass}"/>'
        f"<inertia {rows}/></inertial>"
    )


BODY = {"ixx": 0.03, "iyy": 0.025, "izz": 0.05, "ixy": 0.001, "ixz": -0.002, "iyz": 0.0005}
TINY = {"ixx": 1e-6, "iyy": 1e-6, "izz": 1e-6, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
SMALL = {"ixx": 2e-5, "iyy": 3e-5, "izz": 4e-5, "ixy": 1e-6, "ixz": 0.0, "iyz": -2e-6}


def write_hexa(folder: Path, change: tuple[str, str] = ("", "")) -> Path:
    """A tilted hexarotor in two SDF files of the layout models/NAME/model.sdf."""
    links, plugins = [], []
    for i in range(6):
        turn = 1.0471975511965976 * i
        tilt = 0.5 if i % 2 else -0.5
        links.append(f"""
<link name="rotor_{i}"><pose relative_to="arm_{i}">0.3 0 0.05 {tilt} 0 0</pose>
{inertial("sdf", 0.02, "0 0 0.01", SMALL)}</link>
<frame name="arm_{i}" attached_to="base"><pose degrees="true">0 0 0 0 0 {60.0 * i}</pose></frame>
<joint name="rotor_{i}_joint" type="revolute"><parent>base</parent><child>rotor_{i}</child>
<axis><xyz>0 0 1</xyz><limit><lower>-1e16</lower><upper>1e16</upper></limit></axis></joint>""")
        plugins.append(f"""
<plugin filename="gz-sim-multicopter-motor-model-system" name="m{i}">
<jointName>rotor_{i}_joint</jointName><linkName>rotor_{i}</linkName>
<turningDirection>{"ccw" if i % 2 else "cw"}</turningDirection>
<timeConstantUp>0.02</timeConstantUp><timeConstantDown>0.03</timeConstantDown>
<maxRotVelocity>{FASTEST}</maxRotVelocity><motorConstant>{KF}</motorConstant>
<momentConstant>{KM}</momentConstant><rotorDragCoefficient>8e-5</rotorDragCoefficient>
<rollingMomentCoefficient>1e-6</rollingMomentCoefficient></plugin>""")
        del turn
    base = f"""
<sdf version="1.9"><model name="hexa_base"><pose>0 0 .24 0 0 0</pose>
<link name="base"><pose>0 0 0.02 0 0 0.4</pose>{inertial("sdf", 2.1, "0.01 0 0.02", BODY)}
<visual name="v"><geometry><mesh><uri>model://hexa_base/body.dae</uri></mesh></geometry></visual>
</link>{"".join(links)}</model></sdf>"""
    top = f"""
<sdf version="1.9"><model name="hexa"><include merge="true"><uri>model://hexa_base</uri></include>
{"".join(plugins)}</model></sdf>"""
    write(folder / "hexa_base" / "model.sdf", base)
    return write(folder / "hexa" / "model.sdf", top.replace(*change) if change[0] else top)


def write_urdf_quad(folder: Path) -> Path:
    """A quadrotor with its arm in one URDF; the root link carries most of the mass."""
    rotors = "".join(
        f"""<link name="thrust{i}">{inertial("urdf", 0.03, "0 0 0", SMALL)}</link>
<joint name="rotor{i}" type="continuous"><parent link="main_body"/><child link="thrust{i}"/>
<origin xyz="{x} {y} 0.03" rpy="0 0 0"/><axis xyz="0 0 {axis}"/>
<limit lower="0.5" upper="6" effort="100" velocity="0.5"/></joint>"""
        for i, (x, y, axis) in enumerate([(0.2, 0.2, 1), (-0.2, 0.2, -1), (-0.2, -0.2, 1),
                                          (0.2, -0.2, -1)], start=1)
    )  # fmt: skip
    return write(
        folder / "flyer.urdf",
        f"""
<robot name="flyer"><link name="main_body">{inertial("urdf", 0.55, "0.01 0.02 0", BODY)}</link>
{rotors}
<joint name="shoulder" type="revolute"><parent link="main_body"/><child link="upper"/>
<origin xyz="0.05 0 -0.04" rpy="0.3 -0.2 0.7"/><axis xyz="0.6 0.8 0"/>
<limit lower="-1" upper="1.5" effort="1.2" velocity="5"/></joint>
<link name="upper">{inertial("urdf", 0.08, "0.05 0.01 0", SMALL)}</link>
<joint name="rail" type="prismatic"><parent link="upper"/><child link="slider"/>
<origin xyz="0.1 0.02 0.03" rpy="0 0.4 0"/><axis xyz="0 0 -1"/>
<limit lower="0" upper="0.12" effort="30" velocity="0.2"/></joint>
<link name="slider">{inertial("urdf", 0.05, "0 0 -0.03", SMALL)}</link>
<joint name="end" type="fixed"><parent link="slider"/><child link="tool0"/>
<origin xyz="0.02 0.01 -0.08" rpy="0 0 0"/></joint><link name="tool0"/>
<transmission name="drive"><type>transmission_interface/SimpleTransmission</type>
<joint name="shoulder"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
<actuator name="m"><mechanicalReduction>1</mechanicalReduction></actuator></transmission>
</robot>""",
    )


def urdf_arm(folder: Path, mass: str = "0.09") -> Path:
    """An arm of four hinges with a gripper."""
    mesh = '<geometry><mesh filename="package://arm/meshes/link.stl" scale="1e-3 1e-3 1e-3"/></geometry>'
    places = ["0.012 0 0.017", "0 0 0.06", "0.024 0 0.128", "0.124 0 0"]
    text = f"""<robot xmlns:xacro="http://ros.org/wiki/xacro">
<link name="link1"><visual>{mesh}</visual><collision>{mesh}</collision>
{inertial("urdf", 0.0, "3e-4 0 -1e-4", SMALL).replace('value="0.0"', f'value="{mass}"')}</link>"""
    for i, xyz in enumerate(places, start=1):
        axis = "0 0 1" if i == 1 else "0 1 0"
        text += f"""
<joint name="joint{i}" type="revolute"><parent link="link{i}"/><child link="link{i + 1}"/>
<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/>
<limit velocity="4.8" effort="1000" lower="-1.{i}" upper="1.{i}"/></joint>
<link name="link{i + 1}"><visual>{mesh}</visual>
{inertial("urdf", 0.1 + 0.01 * i, "0.03 5e-4 0.02", SMALL)}</link>"""
    for name, y, mimic in (("grip", 0.02, ""), ("grip_sub", -0.02, '<mimic joint="grip"/>')):
        text += f"""
<joint name="{name}" type="prismatic"><parent link="link5"/><child link="{name}_link"/>
<origin xyz="0.08 {y} 0"/><axis xyz="0 {1 if y > 0 else -1} 0"/>
<limit velocity="1" effort="1" lower="-0.01" upper="0.019"/>{mimic}</joint>
<link name="{name}_link">{inertial("urdf", 0.001, "0 0 0", TINY)}
</link>"""
    text += """
<joint name="ee" type="fixed"><parent link="link5"/><child link="end_effector_link"/>
<origin xyz="0.126 0 0"/></joint><link name="end_effector_link"/></robot>"""
    return write(folder / "arm.urdf", text)


def mjcf_arm(folder: Path) -> Path:
    """An arm of six joints with a gripper."""
    joints = [("0 0 0.07", "0 0 1"), ("0 0 0.04", "0 1 0"), ("0.05 0 0.25", "0 1 0"),
              ("0.17 0 0", "1 0 0"), ("0.08 0 0", "0 1 0"), ("0.06 0 0", "1 0 0")]  # fmt: skip
    text, close = "", ""
    for i, (pos, axis) in enumerate(joints):
        text += f"""<body name="vx/link{i}" pos="{pos}">
<inertial pos="0.03 0.001 0.02" quat="0.7 0.1 0.5 -0.2" mass="{0.4 - 0.05 * i}"
 diaginertia="6e-4 5e-4 3.5e-4"/>
<joint name="j{i}" axis="{axis}" range="-1.5 1.{i}"/>
<geom type="mesh" mesh="part" class="hull"/>"""
        close += "</body>"
    finger = '<inertial pos="0.01 0 0" mass="0.016" diaginertia="5e-6 4e-6 2e-6"/>'
    text += f"""<body name="vx/left" pos="0.07 0 0">{finger}
<joint name="left" axis="0 1 0" type="slide" range="0.015 0.04"/></body>
<body name="vx/right" pos="0.07 0 0">{finger}
<joint name="right" axis="0 1 0" type="slide" range="-0.04 -0.015"/></body>"""
    drives = "".join(f'<position joint="j{i}" kp="50" forcerange="-30 30"/>' for i in range(6))
    return write(
        folder / "arm.xml",
        f"""
<mujoco model="vx"><compiler angle="radian" meshdir="assets" autolimits="true"/>
<option integrator="implicitfast" cone="elliptic"/>
<asset><mesh name="part" file="part.stl"/></asset>
<default><default class="hull"><geom group="3"/></default><joint armature="0.1"/></default>
<worldbody><body name="vx/base">
<inertial pos="-0.04 0 0.02" quat="0.5 0.5 -0.5 0.5" mass="0.5" diaginertia="0.0025 0.0021 0.0007"/>
{text}{close}</body></worldbody>
<equality><joint joint1="left" joint2="right" polycoef="0 -1 0 0 0"/></equality>
<actuator>{drives}<position joint="left" kp="200"/></actuator></mujoco>""",
    )


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.strip() + "\n", encoding="utf-8")
    return path


def sdf_gripper(folder: Path, fingers: int = 2, mass: float = 0.02, turned: str = "") -> Path:
    """An arm of one joint in SDF with fingers that slide along y; a third one is beside them."""
    links, joints = "", ""
    for k in range(fingers):
        side = (1.0, -1.0, 1.0)[k]
        links += f"""<link name="finger{k}"><pose relative_to="palm">0.05 {0.001 * side} 0 0 0 0</pose>
{inertial("sdf", mass, "0.02 0 0", TINY)}</link>"""
        axis = turned if turned and k == 1 else f"0 {side} 0"
        joints += f"""<joint name="slide{k}" type="prismatic"><parent>palm</parent>
<child>finger{k}</child><axis><xyz>{axis}</xyz><limit><lower>0</lower><upper>0.03</upper>
<effort>12</effort><velocity>0.08</velocity></limit></axis></joint>"""
    return write(
        folder / "claw" / "model.sdf",
        f"""
<sdf version="1.9"><model name="claw"><link name="base">{inertial("sdf", 0.1, "0 0 0", SMALL)}</link>
<link name="palm"><pose>0.1 0 0 0 0 0</pose>{inertial("sdf", 0.05, "0.02 0 0", SMALL)}</link>
<joint name="shoulder" type="revolute"><parent>base</parent><child>palm</child>
<axis><xyz>0 1 0</xyz><limit><lower>-1.5</lower><upper>1.5</upper><effort>2</effort>
<velocity>5</velocity></limit></axis></joint>{links}{joints}</model></sdf>""",
    )


PALM = 0.05  # m, from the shoulder to the pivots of turning fingers
PIVOT, LEAN, SPAN, AWAY = 0.025, 0.2, (-0.7, 0.3), 0.02
"""m from the middle; rad that a finger leans outward at zero; its limits; m to a finger's centre."""


def turning_gripper(folder: Path, kind: str) -> Path:
    """An arm of one joint along x with fingers that turn in the plane of x and y."""
    low, high = SPAN
    if kind == "urdf":
        text = f'''<link name="base">{inertial("urdf", 0.1, "0 0 0", SMALL)}</link>
<link name="palm">{inertial("urdf", 0.08, "0.02 0 0", SMALL)}</link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="palm"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" effort="2" velocity="5"/></joint>
<joint name="end" type="fixed"><parent link="palm"/><child link="tcp"/>
<origin xyz="{PALM + 0.05} 0 0"/></joint><link name="tcp"/>'''
        for k, side in enumerate((1, -1)):
            mimic = '<mimic joint="turn0" multiplier="-1"/>' if k else ""
            text += f'''<joint name="turn{k}" type="revolute"><parent link="palm"/>
<child link="finger{k}"/><origin xyz="{PALM} {side * PIVOT} 0" rpy="0 0 {side * LEAN}"/>
<axis xyz="0 0 1"/><limit lower="{low}" upper="{high}" effort="0.6" velocity="2"/>{mimic}</joint>
<link name="finger{k}">{inertial("urdf", 0.004, "0.01 0 0", TINY)}</link>
<joint name="pad{k}" type="fixed"><parent link="finger{k}"/><child link="fingertip{k}"/>
<origin xyz="0.02 0 0"/></joint>
<link name="fingertip{k}">{inertial("urdf", 0.004, "0.01 0 0", TINY)}</link>'''
        return write(folder / "claw.urdf", f'<robot name="claw">{text}</robot>')
    if kind == "sdf":
        text = f"""<link name="base">{inertial("sdf", 0.1, "0 0 0", SMALL)}</link>
<link name="palm">{inertial("sdf", 0.08, "0.02 0 0", SMALL)}</link>
<joint name="shoulder" type="revolute"><parent>base</parent><child>palm</child>
<axis><xyz>0 1 0</xyz><limit><lower>-1.5</lower><upper>1.5</upper><effort>2</effort>
<velocity>5</velocity></limit></axis></joint>"""
        for k, side in enumerate((1, -1)):
            mimic = '<mimic joint="turn0"><multiplier>1</multiplier></mimic>' if k else ""
            text += f"""<link name="finger{k}">
<pose relative_to="palm">{PALM} {side * PIVOT} 0 0 0 {side * LEAN}</pose>
{inertial("sdf", 0.008, "0.02 0 0", TINY)}</link>
<joint name="turn{k}" type="revolute"><parent>palm</parent><child>finger{k}</child>
<axis><xyz>0 0 {side}</xyz><limit><lower>{low}</lower><upper>{high}</upper><effort>0.6</effort>
<velocity>2</velocity></limit>{mimic}</axis></joint>"""
        return write(
            folder / "claw" / "model.sdf",
            f'<sdf version="1.9"><model name="claw">{text}</model></sdf>',
        )
    fingers = ""
    for k, side in enumerate((1, -1)):
        limits = "" if k else f'range="{low} {high}"'
        fingers += f'''<body name="finger{k}" pos="{PALM} {side * PIVOT} 0" euler="0 0 {side * LEAN}">
<joint name="turn{k}" axis="0 0 1" {limits}/>
<inertial pos="0.02 0 0" mass="0.008" diaginertia="1e-6 1e-6 1e-6"/></body>'''
    return write(
        folder / "claw.xml",
        f"""<mujoco model="claw"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="base"><inertial pos="0 0 0" mass="0.1" diaginertia="2e-5 3e-5 4e-5"/>
<body name="palm"><joint name="shoulder" axis="0 1 0" range="-1.5 1.5"/>
<inertial pos="0.02 0 0" mass="0.08" diaginertia="2e-5 3e-5 4e-5"/>{fingers}</body></body></worldbody>
<equality><joint joint1="turn1" joint2="turn0" polycoef="0 -1 0 0 0"/></equality>
<actuator><motor joint="turn0" forcerange="-0.6 0.6"/></actuator></mujoco>""",
    )
