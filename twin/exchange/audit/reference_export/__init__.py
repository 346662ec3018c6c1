"""Compare an export, field by field, with a new export of the robot that its files state.

The other checks of an audit know what a file means, and judge it by a mechanism or by another file. This one knows the
syntaxes only, and finds each place where a file is not what twin writes, whatever the place means. It says nothing of
whether what twin writes is right, which the other checks do. The caller makes the new export: no audit imports a
writer.

entries           the content of a file as a tree, in one form for all syntaxes
difference        where two trees differ
*_entries         read a file of a syntax: json, xml, text (also tables and meshes), usd, gltf
field_comparison  compare a file, or the files of a folder, with those of the new export
export_statement  what the files state of their origin, and the new export that the caller makes from it
"""

from twin.exchange.audit.reference_export.export_statement import ExportStatement, NewExport, export_statement
from twin.exchange.audit.reference_export.field_comparison import compare_with_reference, not_compared

__all__ = ["ExportStatement", "NewExport", "compare_with_reference", "export_statement", "not_compared"]
