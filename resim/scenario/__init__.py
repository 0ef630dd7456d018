"""The scenario description: JSCEN files, and the splines of speed and heading they hold."""
