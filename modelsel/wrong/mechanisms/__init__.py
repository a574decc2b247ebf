"""The built-in mechanisms by kind; `registry.BUILTIN` is the table of them."""
