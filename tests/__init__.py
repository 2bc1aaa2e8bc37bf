"""Laws and acceptance of nhpocp; rooms mirror the package's, `program` holds what concerns it as a whole."""
