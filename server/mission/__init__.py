"""The mission: from take-off to a finished field."""
