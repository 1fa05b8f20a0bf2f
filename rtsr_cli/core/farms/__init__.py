"""Jobs of render farms: a command divided into tasks, in the words of engines that there are."""
