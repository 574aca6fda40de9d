"""How bytes that others wrote come in: from regular files only, bounded, and every failure is an error of ours."""
