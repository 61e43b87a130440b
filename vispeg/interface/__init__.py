"""What a policy sees of a robot and what its actions ask of it, without a simulator.

Training, evaluation, `vispeg run` and whoever holds an exported file build observations here: `Observer` from an
`Interface`. NumPy and the standard library alone; pictures of another camera also need OpenCV.
"""
