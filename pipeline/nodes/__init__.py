"""What a node is, and the nodes: state between messages around pure functions."""
