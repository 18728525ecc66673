"""Training of crowd detectors: labelled missions in, an ONNX model with its report out.

`labels` says what the network should mark, `frame_store` keeps decoded frames, `augmentation` varies them,
`plan` holds every number, `network` is the architecture, `trainer` the loop, `onnx_export` the result. The
last three and `crops` need PyTorch (`pip install crowdfence[train]`).
"""
