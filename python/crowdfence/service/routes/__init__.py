"""HTTP and WebSocket: parse, call, answer. One module per subject."""
