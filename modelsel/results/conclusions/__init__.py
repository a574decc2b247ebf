"""What a study concludes: the verdict, cautions, what each finding is worth, goodness of fit."""
