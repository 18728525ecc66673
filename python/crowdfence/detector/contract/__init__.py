"""What a model expects and what its output means: the contract, its parts, and the places it is read from."""
