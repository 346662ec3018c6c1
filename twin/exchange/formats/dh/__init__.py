"""Tables of Denavit-Hartenberg parameters, as papers and manuals print them: robots that `twin new` reads."""
