"""Code from outside (AD functions, own measures): frozen, loaded in a namespace of its own, and watched."""
