"""The paper's three tasks and Gymnasium's environments, as plug-ins: what they are, and their rewards from pixels.

Their robots are plug-ins of `bpn_robot_sim`. Nothing here needs MuJoCo or Gymnasium; rewards need OpenCV.
"""
