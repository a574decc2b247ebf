"""The pages of the PDF report."""
