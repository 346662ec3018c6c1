"""Other formats: `read` imports files, `write` exports them, `audit` checks exports. They do not import each other."""
