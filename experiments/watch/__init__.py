"""At the bench: each take judged as its files arrive, and what is still missing for the answers that are wanted."""
