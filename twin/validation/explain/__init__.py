"""Explain a disagreement: locate the wrong row of an equation, and find the smallest source edit that fixes it.

A row is one assignment of a formula. Words: an edit replaces text of a row; a candidate is an edit with the residuals
of the rows after it; a cure is a function that makes the rows of a group agree, a reading is one text of this function.

The modules, from the equations to the result:

- text of equations: `function_source`, `tokens`, `edit_tidying`, `augmented_assignments`
- equations on arrays: `rebuilt_functions`, `plain_values`
- values of the mechanism: `reference_values`, `judged_states`
- rows compared with it: `equation_steps`, `row_deviations`, `swivel`, `suspect_statements`, `coverage`, `invariants`
- edits to try: `name_pool`, `statement_edits`, `counterparts`, `analogies`, `term_texts`, `vector_texts`
- one edit: `candidate`, `trials`, `dependence` with `determined_unknowns`, `formula_state`, `single_edits`,
  `single_search`
- values that expressions must have: `expression_shifts`, `inverse_operations`, `expression`, `required_values`,
  `batched_solutions`
- two edits: `pair_search` with `required_pairs`, `term_pairs`, `statement_pairs` and `operand_pairs`; then
  `position_pairs` with `replacement_pairs`
- the choice among repairs: `repair_search`, `repair_choice`, `edited_functions`, `parameter_coincidences`,
  `proved_repairs`
- other explanations: `wrong_parameters` with `parameter_fit`, `conventions` with `convention_rows`,
  `pose_conventions` and `denavit_hartenberg`, `cad_faults`
- the result: `explain`, `possible_fixes`, `explanation` with its data, rows and repairs; all within a `deadline`
"""
