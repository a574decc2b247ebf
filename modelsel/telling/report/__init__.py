"""The report of a study: report.pdf and report.html beside result.json, drawn from result.json and details.json alone."""
