"""A new study from a file as people have it: how its columns are read, checked on the nominal arm."""
