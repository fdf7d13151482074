"""`furrowmap record`: what scanners and receivers send, into files that `furrowmap run` reads."""
