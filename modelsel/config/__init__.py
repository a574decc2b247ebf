"""What is asked: study and fleet files."""
