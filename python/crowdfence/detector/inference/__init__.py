"""Image -> tensor -> model -> heatmap, for ONNX models and for Python functions."""
