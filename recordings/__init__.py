"""The campaign: runs, streams and channels as frozen data; read, validated and written; units at the border only."""
