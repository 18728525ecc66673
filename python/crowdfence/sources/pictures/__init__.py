"""Pictures and videos: single files decoded, many as a stream."""
