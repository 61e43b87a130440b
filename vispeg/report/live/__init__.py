"""What a page draws for the mouse: charts over time, the arm in 3D."""
