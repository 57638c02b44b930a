; pil_stops: the two empty functions where the harness stops a simulated processor
	.module	pil_stops
	.globl	_pil_wait, _pil_done
	.area	_CODE
_pil_wait:
	ret
_pil_done:
	ret
