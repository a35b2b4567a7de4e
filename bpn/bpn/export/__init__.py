"""Runs and policies in the formats of others: ONNX, QONNX, C, tables, LeRobot replay_iterations, films."""
