"""Pictures, labels and depth of a scene. Nothing here is imported unless a scene is rendered."""
