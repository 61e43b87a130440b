"""A policy's observations and actions on a robot, without a simulator.

Training, evaluation, `vispeg run` and users of an exported file all build observations here, with an `Observer` that is
made from an `Interface`. It needs only NumPy and the standard library; pictures of another camera also need OpenCV.
"""
