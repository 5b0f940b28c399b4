"""What a run showed: summary, rates, evaluation, comparison, agreement with labels, export."""
