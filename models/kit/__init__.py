"""What every block is declared with."""
