"""Named exceptions, rigid motions, the version."""
