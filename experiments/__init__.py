"""One file, one claim: the paper's figures and tables, studies, proofs, reports; no physics of its own."""
