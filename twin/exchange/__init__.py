"""Other formats: `read` imports files, `write` exports them, `audit` checks exports. None of the three uses another."""
