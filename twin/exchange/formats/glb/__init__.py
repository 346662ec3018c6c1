"""glTF 2.0, as one binary file: shapes and all motions."""
