"""What is drawn into Rerun: tower, tracks, foundation, plane plots."""
