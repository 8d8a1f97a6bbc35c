"""How bytes get to a brick and back: each module opens one kind of link."""
