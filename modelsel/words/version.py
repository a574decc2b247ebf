"""The one place that says which modelsel this is."""

VERSION = "0.1.0"
