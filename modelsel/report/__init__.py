"""Terminal, PDF and HTML reports."""
