"""Phase retrieval from autocorrelations, which learns nothing."""
