"""What is simulated: frozen, validated values that know no compiler."""
