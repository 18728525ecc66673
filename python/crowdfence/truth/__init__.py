"""Where crowds are: what a crowd is, and what is true of the pixels and the terrain of a recording."""
