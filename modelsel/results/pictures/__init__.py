"""What pictures need: panels of findings, the arm as it is drawn, postures."""
