; crt0: from reset to main on the Rabbit 4000
;
; Logical memory:
;   0x0000 - 0x5fff  this start-up, interrupt handlers, arithmetic, what fits: flash at /CS0, there from reset on
;   0x6000 - 0xdfff  one of two banks of flash, the data segment: the rest of the program, or the estimator,
;                    which banks.s switches in (physical = logical + 0x10000)
;   0xe000 - 0xffff  static data, and from the end downwards the stack: RAM at /CS1, by the window of XPC
;                    (physical = logical + 0x80000)
;
; Interrupts stay off, as reset left them (priority 3), until port_init has set the table of vectors and lowers the
; priority. The watchdog, 2 s after reset, is reset by the port as well.

	.module	crt0
	.globl	_main
	.globl	s__DATA, l__DATA, s__INITIALIZER, s__INITIALIZED, l__INITIALIZER

DATASEG	.equ	0x12		; data segment: physical = logical + 0x1000 * this
DATASEGH .equ	0x1f		; bits 11 to 8 of that
SEGSIZE	.equ	0x13		; first 4 kB of the stack segment (bits 7 to 4) and of the data segment (3 to 0)
MB2CR	.equ	0x16		; what answers from physical 0x80000 to 0xbffff
RAM	.equ	0x05		; /CS1, /OE1, /WE1, 4 wait states: the slowest
AT_RAM	.equ	0x80
BANKS	.equ	0xe6		; from 0x6000 to 0xdfff; no stack segment

	; ---------------- in the order of memory
	.area	_CODE
	.area	_HOME
	.area	_BANK0
	.area	_CONST
	.area	_INITIALIZER
	.area	_GSINIT
	.area	_GSFINAL
	.area	_BANK1
	.area	_DATA
	.area	_INITIALIZED
	.area	_BSEG
	.area	_BSS
	.area	_HEAP

	.area	_START (ABS)
	.org	0
	ld	a, #RAM
	ioi
	ld	(MB2CR), a
	ld	a, #AT_RAM
	ld	xpc, a
	xor	a, a
	ioi
	ld	(DATASEGH), a		; the simulator begins with 1 here
	ioi
	ld	(DATASEG), a
	ld	a, #BANKS
	ioi
	ld	(SEGSIZE), a
	ld	sp, #0			; the first push goes to 0xfffe

	; static data: 0, or its start values
	ld	hl, #s__DATA
	ld	(hl), #0
	ld	de, #s__DATA + 1
	ld	bc, #l__DATA - 1	; there are some: the program's
	ldir
	ld	bc, #l__INITIALIZER
	ld	a, b
	or	a, c
	jr	z, initialized
	ld	hl, #s__INITIALIZER
	ld	de, #s__INITIALIZED
	ldir
initialized:
	call	gsinit
	call	_main			; for ever
stop:
	jr	stop

	.area	_GSINIT
gsinit:					; what the C files add stands in between
	.area	_GSFINAL
	ret
