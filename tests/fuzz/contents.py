"""What the files hold that are changed."""

import numpy as np

from pbd.data import Keyframe
from pbd.pose import Pose

DEMO = """\
format = 1
name = "tea"
created = "2026-01-02T03:04:05Z"
sensor = "a sensor"
clock = "the computer's"
rate_hz = 100.0
notes = "a note"
closed = true
[object]
shape = "cylinder"
size = [0.06, 0.12]
[[grip]]
t_s = 0.1
closed = true
[[place]]
t_s = [0.05, 0.2]
position_m = [0.1, 0.2, 0.0]
sigma_m = 0.002
[[contact]]
t_s = 0.1
height_m = 0.05
"""

KEYFRAMES = tuple(
    Keyframe(float(k), 0.5, Pose(np.array([0.1 * k, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])), np.eye(6) * 1e-6, grip)
    for k, grip in enumerate((None, True, None, False))
)

CALIBRATION = """\
format = 1
name = "bench"
table_height = 0.01
scale = 0.9
robots = ["panda"]
[dock]
position = [0.45, -0.15, 0.25]
rpy_deg = [0.0, 0.0, 90.0]
sigma_m = [0.001, 0.001, 0.002]
sigma_deg = [0.1, 0.1, 0.5]
fit = { rms_mm = 1.5, points = 4 }
[mount]
position = [0.0, 0.0, 0.1]
rpy_deg = [180.0, 0.0, 0.0]
[[obstacle]]
name = "shelf"
shape = "box"
size = [0.1, 0.2, 0.3]
position = [0.5, 0.5, 0.2]
rpy_deg = [0.0, 0.0, 45.0]
[sensor]
name = "mine"
gravity = 9.81
[sensor.gyr]
bias = [0.01, 0.0, 0.0]
matrix = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
"""

POINTS = "# by hand\nname,x_mm,y_mm,z_mm\na,100,200,300\nb,-100,20.5,3\nc,1,2,3\n"

LAYOUT = """\
separator = "space"
columns = "t,ax,ay,az,gx,gy,gz"
prefix = "#"
wrap = 4294967296
[units]
t = "us"
acc = "0.001 g"
gyr = "deg/s"
"""


def rows(first: str, count: int, step: float, width: int, delimiter: str = ",") -> str:
    times = (first.format(k, step * k) for k in range(count))
    cells = delimiter.join(f"{0.25 * k:g}" for k in range(width))
    return "".join(f"{t}{delimiter}{cells}\n" for t in times)


_XIO = ",".join(
    f"{what} {axis} ({unit})" for what, unit in (("Gyroscope", "deg/s"), ("Accelerometer", "g")) for axis in "XYZ"
)
TABLES = {
    "Inertial.csv": f"Timestamp (us),{_XIO}\n" + rows("{0}0000", 12, 0.01, 6),
    "log.txt": "StartTime：2025-10-09 08:18:09.090\n"
    + "\t".join(["address", "Time(s)", "ax(g)", "ay(g)", "az(g)", "wx(deg/s)", "wy(deg/s)", "wz(deg/s)"])
    + "\n"
    + rows("0x50\t 08:18:{0:02d}.500", 12, 0.01, 6, "\t"),
    "log.csv": "时间,设备名称,片上时间(),加速度X(g),加速度Y(g),加速度Z(g),角速度X(°/s),角速度Y(°/s),角速度Z(°/s)\n"
    + rows("2026-10-02 07:48:{0:02d}.830,WT,2025-10-9 8:18:{0}:94", 12, 0.01, 6),
    "semicolons.csv": "t;ax;ay;az;gx;gy;gz\n" + rows("0,{0:02d}", 12, 0.01, 6, ";").replace(".", ","),
    "holes.tsv": "time\tacc_x [g]\tacc_y [g]\tacc_z [g]\n" + rows("{1:.2f}", 12, 0.01, 3, "\t").replace("0.5", ""),
}
MAGNETOMETER = "Timestamp (us),Magnetometer X (a.u.),Magnetometer Y (a.u.),Magnetometer Z (a.u.)\n" + rows(
    "{0}0000", 12, 0.01, 3
)

PRINTED = "".join(
    f"Acceleration X: {0.1 * k:.2f}, Y: 0.10, Z: 9.81 m/s^2\nRotation X: 0.01, Y: {-0.02 * k:.2f}, Z: 0 rad/s\n"
    for k in range(12)
)

ARRAYS = {
    "rate_hz": 100.0,
    "acc": np.full((20, 3), 9.81),
    "gyr": np.zeros((20, 3)),
    "mag": np.ones((20, 3), dtype=np.float32),
    "true_position": np.zeros((20, 3)),
    "true_wxyz": np.tile((1.0, 0.0, 0.0, 0.0), (20, 1)),
    "other": np.arange(3),
}

ROBOT = """\
format = 1
name = "mine"
description = "two joints and a claw"
[model]
urdf = "mine.urdf"
srdf = "mine.srdf"
base = "foot"
body = "hand"
T_body_tool = { xyz = [0.0, 0.0, 0.1], rpy_deg = [0.0, 0.0, 90.0] }
[arm]
joints = ["shoulder", "elbow"]
home_pose = "rest"
[gripper]
joints = ["claw"]
open = [0.5]
closed = [0.0]
stroke_s = 0.5
[limits]
source = "measured"
acceleration = [5.0, 6.0]
jerk = [100, 200]
[dock]
position = [0.45, -0.15, 0.25]
rpy_deg = [0.0, 0.0, 0.0]
table_height = 0.0
"""

URDF = """\
<?xml version="1.0" encoding="UTF-8"?>
<robot name="mine">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="foot"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="upper">
    <inertial><origin xyz="0 0 0.1" rpy="0 0 0"/><mass value="1.5"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <visual><origin xyz="0 0 0.1" rpy="0 0 0.5"/><geometry><cylinder radius="0.03" length="0.2"/></geometry>
      <material name="red"/></visual>
    <collision><origin xyz="0 0 0.1"/><geometry><mesh filename="a.stl" scale="1 1 1"/></geometry></collision>
  </link>
  <link name="hand"><visual><geometry><mesh filename="package://a.dae" scale="0.5 0.5 0.5"/></geometry></visual></link>
  <link name="finger"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="foot"/><child link="upper"/>
    <origin xyz="0 0 0.2" rpy="0 0 0.1"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="2.5" effort="1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="hand"/>
    <origin xyz="0 0 0.3" rpy="0.2 0 0"/><axis xyz="0 1 0"/><limit velocity="2.5" effort="1"/></joint>
  <joint name="claw" type="prismatic"><parent link="hand"/><child link="finger"/><origin xyz="0 0 0.1"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.6" velocity="1" effort="1"/></joint>
</robot>
"""

SRDF = """\
<?xml version="1.0"?>
<robot name="mine">
  <group_state name="rest" group="arm">
    <joint name="shoulder" value="0.5"/><joint name="elbow" value="-1"/></group_state>
  <disable_collisions link1="foot" link2="upper" reason="Adjacent"/>
</robot>
"""

DAE = """\
<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.1"/></asset>
<library_effects><effect id="e"><profile_COMMON><technique><phong><diffuse><color>1 0 0 1</color></diffuse></phong>
</technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
<technique_common><accessor source="#f" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles material="red" count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3</p></triangles>
<polylist material="red" count="2"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>3 3</vcount><p>0 3 2 1 2 3</p></polylist>
</mesh></geometry></library_geometries>
<library_nodes><node id="n"><scale>1 2 1</scale><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="w"><node id="o"><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix>
<translate>0 0 1</translate><rotate>0 0 1 90</rotate><instance_node url="#n"/>
<node><instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="red" target="#m"/>
</technique_common></bind_material></instance_geometry></node></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene>
</COLLADA>
"""
