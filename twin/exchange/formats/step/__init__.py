"""STEP: shapes of an assembly, without joints."""
