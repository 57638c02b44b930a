"""How much memory a process took, for those that tests start."""

# ru_maxrss would count the memory of the process that started it, too
PRINT_PEAK = (
    "with open('/proc/self/status') as status:\n"
    "    print(next(int(line.split()[1]) for line in status if line.startswith('VmHWM')) // 1024)  # MiB"
)
