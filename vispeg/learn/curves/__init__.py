"""How a run tells where it is: its table, the terminal, TensorBoard, Weights & Biases."""
