"""Descriptions from files of other programs: OpenFAST (ElastoDyn, SubDyn), BModes, WindIO."""
