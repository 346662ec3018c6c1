"""Read files that describe moving robots, whoever wrote them, and say what is wrong. Shares no code with a writer."""
