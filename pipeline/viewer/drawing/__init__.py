"""Write pictures as Rerun entities: tower, tracks, foundation, plane plots."""
