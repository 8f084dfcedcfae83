"""The commands: one frozen record of arguments each, whose fields make its flags and whose comments make its help."""
