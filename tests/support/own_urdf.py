"""A URDF as people have it, and a calibration of its arm: comments, meshes, masses, a gripper, odd
white space and quotes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from builders import drawn, planted

from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.refitting import refit_forms
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.kinematics import Robot
from modelsel.selection.evaluation import Split

BODY = (
    '<inertial>\n      <origin xyz="0 0 0.02"/>\n      <mass value="{mass}"/>\n'
    '      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/>\n    </inertial>'
)
OWN = """<?xml version="1.0" encoding="utf-8"?>
<!-- <joint name="a"><origin xyz="9 9 9"/></joint>: kept, with > and Ü -->
<robot name='müller "cell 3"' xmlns:xacro="http://www.ros.org/wiki/xacro">
  <mujoco><compiler fusestatic="false" balanceinertia="true"/></mujoco>
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="world"/>
  <link name="foot">
    {body}
    <visual><origin xyz="0 0 0.1" rpy="0 0 1.57"/><geometry><mesh filename="package://cell/foot.dae"/></geometry></visual>
    <collision>
      <origin rpy="0 0 0" xyz="0 0 0.05" />
      <geometry><cylinder radius="0.06" length="0.1"/></geometry>
    </collision>
  </link>
  <joint name="mount" type="fixed"><parent link="world"/><child link="foot"/><origin xyz="0.1 0 0.5" rpy="0 0 0.5"/></joint>
  <link name="shoulder">{body}</link><link name="upper arm">{body}</link>
\t<link name="forearm">{body}</link>
  <link name="wrist"/> <link name="wrist1">{body}</link>
  <link name="wrist2">{body}</link>
  <link name="hand">{body}</link>
  <joint name="joint_a1" type="revolute">
    <origin
        rpy = '0  0 0'
        xyz = "0 0 0.089159" />
    <parent link="foot"/>   <child link="shoulder"/>
    <axis xyz="0 0 1"/>
    <limit lower="-3.1" upper="3.1" effort="330" velocity="2.16"/>
    <dynamics damping="0.5" friction="0"/>
  </joint>
  <joint name="joint_a2" type="revolute"><parent link="shoulder"/><child link="upper arm"/>
    <origin xyz="0 0.13585 0" rpy="0.0 1.570796325 0.0"/><axis xyz="0 1 0"/><!-- the <axis> stays -->
    <limit lower="-2" upper="2" effort="150" velocity="3"/></joint>
  <joint name="joint_a3" type="revolute">
    <parent link="upper arm"/><child link="forearm"/><axis xyz="0 1 0"/>
    <origin xyz="0 -0.1197 0.425"></origin>
    <limit lower="-2.6" upper="2.6" effort="150" velocity="3"/>
    <safety_controller k_velocity="0" soft_lower_limit="-2.5" soft_upper_limit="2.5"/>
  </joint>
  <joint name="bolted" type="fixed"><origin xyz="0 0 0.39225" rpy="0 1.5707 0"/><parent link="forearm"/><child link="wrist"/></joint>
  <joint name="joint_a4" type="revolute"><parent link="wrist"/><child link="wrist1"/>
    <axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="28" velocity="3"/></joint>
  <joint name="joint_a5" type="revolute"><origin xyz="0 0.093 0"/><parent link="wrist1"/><child link="wrist2"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-3" upper="3" effort="28" velocity="3"/></joint>
  <joint name="joint_a6" type="continuous"><origin rpy="0.1 0 0" xyz="0 0 0.09465"/><parent link="wrist2"/><child link="hand"/><axis xyz="0 1 0"/></joint>
  <link name="flange"/>
  <joint name="tool" type="fixed"><parent link="hand"/><child link="flange"/><origin xyz="0 0.0823 0" rpy="0 0 1.570796325"/></joint>
  <link name="finger">{body}</link>
  <joint name="grip" type="prismatic"><origin xyz="0 0 0.05"/><parent link="flange"/><child link="finger"/><axis xyz="1 0 0"/><limit lower="0" upper="0.04" effort="20" velocity="1"/></joint>
  <transmission name="t1">
    <joint name="joint_a1"><origin xyz="1 2 3"/><child link="shoulder"/></joint>
  </transmission>
</robot>
""".replace("{body}", BODY.format(mass=2.5))


def without_origins(text: str) -> str:
    """The text of a URDF, every origin's tag cut out."""
    return re.sub(r"<origin[^<>]*?>", "", text)


def calibrated(robot: Robot, rng: np.random.Generator, geometry: float = 1.0) -> Calibration:
    """A calibration of an arm with errors of its geometry, of `geometry` mm and mrad, and a soft
    shoulder."""
    model = Model((mechanism("geometric", robot), mechanism("joint-compliance:2", robot)))
    at = replace(drawn(robot, rng, 120), whitening=Whitening(50.0))
    sizes = [
        geometry * (1e-3 if term.screws[0].axis[0] == "r" else 1.0)
        for term in model.mechanisms[0].terms
    ]
    soft = len(model.terms) - len(sizes)
    theta = np.concatenate([rng.normal(0, 1, len(sizes)) * sizes, np.full(soft, 2e-6)])
    at = planted(at, model.terms, theta, rng, 0.02)
    found = fit(at, model)
    every_row = np.ones(len(at), bool)
    data = Split(at, every_row, ~every_row, np.arange(len(at)) % 5, True)
    made = calibrate("own", data, found, Floor(0.02, "stated"), None, False, {})
    return replace(made, refits=refit_forms(data, found))
