; float32 for the Rabbit: the arithmetic that SDCC's C calls, correctly rounded
;
; IEEE 754 binary32, round to nearest, ties to even, with subnormals, signed
; zeros and infinities: the bits that SSE gives on x86-64. A NaN result is the
; quiet NaN 0x7fc00000, but fabsf and floorf keep an operand's payload.
;
; Processor: Rabbit 3000 instructions only. A Rabbit 4000 executes them in its
; Rabbit 3000 mode (EDMR = 0), the mode after reset, which `sdcc -mr3ka` assumes.
; ucsim 0.8.15 loses registers in EXX and spoils bit 15 in ADC HL,BC and ADC HL,DE:
; these are avoided, so that simulator and processor agree.
;
; Calls (sdcccall 1): the first float in HLDE (H = sign and exponent), the second
; on the stack, removed by the callee; float and long results in HLDE, int in HL,
; char and bool in A. IX is preserved; AF, BC, DE, HL, IY and AF', BC', DE', HL'
; are not. 1.9 kB of code, no static memory, reentrant. An interrupt that calls these
; routines, or a kernel that switches tasks, must save the alternate registers too.
;
; "Clocks": simulated, zero wait states, call and return included, the caller's
; pushes not; mean and maximum over operands of 1e-6 to 1e6 in magnitude. Zeros take
; no longer, subnormal operands or results up to 2000. "Stack": bytes below the
; arguments, return address included.
;
; Words used below:
;   current, other an operand in HL, DE and one in HL', DE'; `swap` exchanges them
;   doubled        H = biased exponent, L = upper fraction bits * 2, the rest in DE
;   unpacked       H = biased exponent, L:DE = 24-bit significand, top bit 1
;   significand    of a result: HL:DE, top bit 1; H, L, D are its 24 bits, E the
;                  rounding bit (7), bits below (6 to 1) and the sticky bit (0)
;   A', CF'        biased exponent and sign of the result (1 = negative)

	.module	float
	.r3k
	.area	_CODE

	.globl	___fsadd, ___fssub, ___fsmul, ___fsdiv
	.globl	___fslt, ___fseq
	.globl	___slong2fs, ___ulong2fs, ___sint2fs, ___uint2fs, ___schar2fs, ___uchar2fs
	.globl	___fs2slong, ___fs2ulong, ___fs2sint, ___fs2uint, ___fs2schar, ___fs2uchar
	.globl	_sqrtf, _floorf, _fabsf

; ---------------------------------------------------------------- pieces

; The second operand off the stack: it becomes the other one.
	.macro	take_second
	pop	bc
	altd
	pop	de
	altd
	pop	hl
	push	bc
	.endm

; 10 clocks; no flags.
	.macro	swap
	ex	de', hl
	ex	de, hl
	altd
	ex	de', hl
	ex	de', hl
	.endm

; Unpacks the current operand, doubled, if it is normal; A = exponent - 1. Others:
; zero, subnormal, infinity, NaN.
	.macro	unpack_normal, others
	ld	a, h
	dec	a
	cp	a, #254
	jp	nc, others
	scf
	rr	l
	.endm

; Product of two significands in HL:DE, sticky; A' is incremented if it is 2 or more.
; Each is high * 2^16 + low, low taken as signed, high (128 to 256) one larger where
; low is negative, for `mul` is signed: HL:BC = BC * DE.
; In: HL = b.low, IY = b.high, DE = a.low, DE' = a.high. All registers are used.
	.macro	product, ?positive, ?no_carry, ?no_carry_2, ?exact, ?small, ?end
	push	hl
	ld	b, h
	ld	c, l
	mul				; a.low * b.low; its lower word is sticky bits only
	ld	a, b
	or	a, c
	push	hl
	ld	hl, iy
	ld	b, h
	ld	c, l
	mul				; a.low * b.high
	pop	de
	ex	de, hl
	bit	7, h
	jr	z, positive
	dec	de
positive:
	add	hl, bc			; DE:HL = the sum of both
	jr	nc, no_carry
	inc	de
no_carry:
	ex	de', hl
	ex	de, hl
	ex	(sp), hl
	ld	b, h
	ld	c, l
	mul				; a.high * b.low
	ex	de', hl
	add	hl, bc
	pop	bc
	ex	de', hl
	jr	nc, no_carry_2
	inc	hl
no_carry_2:
	add	hl, bc			; HL:DE' = the sum of the three
	push	hl
	ld	hl, iy
	ld	b, h
	ld	c, l
	mul				; a.high * b.high
	pop	hl
	add	hl, bc
	ex	de, hl
	ex	de', hl
	ex	de, hl
	or	a, a
	jr	z, exact
	set	0, e
exact:
	bit	7, h
	jr	z, small
	ex	af, af'
	inc	a
	ex	af, af'
	jr	end
small:
	or	a, a
	rl	de
	adc	hl, hl
end:
	.endm

; ---------------------------------------------------------------- multiply

; float ___fsmul(float a, float b): a * b.
; Clocks: mean 440, at most 460. Stack: 6.
___fsmul::
	ld	b, h
	add	hl, hl
	unpack_normal	mul_special
	ld	c, h
	ld	h, #0
	bit	7, d
	jr	z, 1$
	inc	hl
1$:	ex	de', hl			; a.high
	ld	hl, 4 (sp)
	ld	a, h
	xor	a, b
	ld	b, a			; bit 7: sign
	add	hl, hl
	unpack_normal	mul_wide
	add	a, c			; both exponents - 1
	jr	c, 2$
	sub	a, #127
	jp	c, mul_wide		; may be subnormal
	jr	3$
2$:	add	a, #129
	jp	c, mul_wide		; overflow
	cp	a, #253
	jp	nc, mul_wide		; may overflow
3$:	ld	c, a
	ld	a, b
	add	a, a
	ld	a, c
	inc	a			; exponent if the product is below 2
	ex	af, af'
	ld	h, #0
	ld	iy, hl
	ld	hl, 2 (sp)
	bit	7, h
	jr	z, 4$
	inc	iy
4$:	product
	pop	bc
	add	sp, #4
	push	bc

; ---------------------------------------------------------------- round and pack

; Rounds HL:DE (E = rounding and lower bits) and packs it with A' and CF'.
; Rounding up to the next power of two moves the exponent on, at the end to infinity.
round_pack:
	sla	e			; carry = rounding bit, zero = nothing below it
	jr	nc, pack
	jr	nz, 1$
	bit	0, d			; a tie: to even
	jr	z, pack
1$:	inc	d
	jr	nz, pack
	inc	l
	jr	nz, pack
	inc	h
	jr	nz, pack
	ex	af, af'
	inc	a			; keeps the carry
	ex	af, af'
pack:
	ld	e, d
	ld	d, l
	ld	l, h
pack_upper:
	sla	l			; the leading 1 is not stored
	ex	af, af'
	ld	h, a
	rr	hl
	ret

; The same for any exponent BC (signed): overflow and subnormal results.
round_pack_wide:
	ld	a, b
	or	a, a
	jp	m, 2$
	jr	nz, infinity
	ld	a, c
	or	a, a
	jr	z, 2$
	inc	a
	jr	z, infinity
	ex	af, af'
	ld	a, c
	ex	af, af'
	jr	round_pack
2$:	ld	a, #1			; subnormal: down to exponent 1, and count
	sub	a, c
	ld	c, a
	ld	a, #0
	sbc	a, b
	jr	nz, 3$
	ld	a, c
	cp	a, #26
	jr	c, 4$
3$:	ld	c, #26			; all below the rounding bit already
4$:	or	a, a
	rr	hl
	rr	de
	jr	nc, 5$
	set	0, e
5$:	dec	c
	jr	nz, 4$
	sla	e			; as in round_pack
	jr	nc, 7$
	jr	nz, 6$
	bit	0, d
	jr	z, 7$
6$:	inc	d
	jr	nz, 7$
	inc	hl
7$:	ex	af, af'
	ld	a, #0
	bit	7, h			; rounded up to the least normal number
	jr	z, 8$
	inc	a
8$:	ex	af, af'
	jr	pack

; CF' = sign.
infinity:
	ld	hl, #0xff00
	jr	pack_constant
zero:
	ld	hl, #0
pack_constant:
	ld	de, #0
	ex	af, af'
	rr	hl
	ret

nan:
	ld	hl, #0x7fc0
	ld	de, #0
	ret

; The current operand, doubled: its class in A and H; if finite and not zero,
; L:DE = significand with its top bit 1 and BC = biased exponent, signed.
FINITE	.equ	0
ZERO	.equ	1
INFINITE .equ	2
NAN	.equ	4
unpack_any:
	srl	l
	ld	c, h
	ld	b, #0
	ld	a, l
	or	a, d
	or	a, e			; zero: no fraction
	inc	h
	jr	z, 3$
	dec	h
	jr	z, 1$
	set	7, l
	ld	h, #FINITE
	jr	4$
1$:	or	a, a
	ld	h, #ZERO
	jr	z, 4$
	inc	bc			; subnormals have exponent 1 and no leading 1
2$:	dec	bc
	sla	e
	rl	d
	rl	l
	jp	p, 2$
	ld	h, #FINITE
	jr	4$
3$:	or	a, a
	ld	h, #INFINITE
	jr	z, 4$
	ld	h, #NAN
4$:	ld	a, h
	ret

; ---------------------------------------------------------------- add, subtract

; float ___fssub(float a, float b): a - b.
; Clocks: mean 350, at most 480. Stack: 2.
___fssub::
	take_second
	altd
	ex	de, hl
	ld	a, d
	xor	a, #0x80
	ld	d, a
	altd
	ex	de, hl
	jr	add_operands

; float ___fsadd(float a, float b): a + b.
; Clocks: mean 330, at most 470. Stack: 2.
___fsadd::
	take_second
add_operands:
	ld	b, h
	add	hl, hl
	ld	a, h
	ex	af, af'			; exponent and sign of a
	unpack_normal	add_special_a
	ld	c, h
	swap
	ld	a, h
	xor	a, b
	ld	b, a			; bit 7: signs differ
	add	hl, hl
	unpack_normal	add_special_b

; Current b, other a, unpacked (subnormals: exponent 1, top bit 0); C = exponent of a.
add_unpacked:
	ld	a, h
	sub	a, c
	jr	nc, 1$
	neg
	jr	3$
1$:	ld	c, a			; b is the larger, or has the same exponent
	ex	af, af'
	ld	a, h
	bit	7, b
	jr	z, 2$
	ccf
2$:	ex	af, af'
	ld	a, c
	swap
3$:	ld	c, b			; now the current operand is the smaller: A places right
	ld	b, a
	ld	h, l
	ld	l, d
	ld	d, e
	ld	e, #0
	cp	a, #8
	jr	nc, shift_bytes
	or	a, a
	jr	z, shifted
4$:	rr	hl			; carry 0: E was empty
	rr	de
	djnz	4$
shifted:
	bit	7, c			; HL:DE + L'D'E'0, or the difference
	ld	b, h
	ld	c, l
	jr	nz, subtract
	ex	de', hl
	ld	a, e
	ld	e, d
	ld	d, c
	add	hl, de
	ld	c, a
	altd
	ex	de, hl
	ld	a, b
	adc	a, e
	ld	d, l
	ld	e, c
	ld	l, h
	ld	h, a
	jr	c, 1$
	jp	m, round_pack
	jr	normalize		; a sum of subnormals
1$:	rr	hl
	rr	de
	jr	nc, 2$
	set	0, e
2$:	ex	af, af'
	inc	a			; keeps the carry
	inc	a
	jr	z, 3$
	dec	a
	ex	af, af'
	jp	round_pack
3$:	ex	af, af'
	jp	infinity

; HL:DE to the right by A = B places, 8 or more; what falls out sets the sticky bit.
shift_bytes:
	cp	a, #26
	jr	nc, larger		; less than a quarter of the last place
	and	a, #7
	jr	z, 2$
1$:	rr	hl
	rr	de
	dec	a
	jr	nz, 1$
2$:	bit	4, b
	jr	nz, 3$
	ld	a, e
	ld	e, d
	ld	d, l
	ld	l, h
	ld	h, #0
	or	a, a
	jr	z, shifted
	set	0, e
	jr	shifted
3$:	ld	a, d
	or	a, e
	ex	de, hl
	ld	hl, #0
	bit	3, b
	jr	z, 4$
	or	a, e
	ld	e, d
	ld	d, l
4$:	or	a, a
	jr	z, shifted
	set	0, e
	jr	shifted

larger:
	swap
	jp	pack_upper

subtract:
	ex	de', hl
	xor	a, a
	sub	a, e
	ld	e, d
	ld	d, c
	ld	c, a
	sbc	hl, de
	altd
	ex	de, hl
	ld	a, e
	sbc	a, b
	ld	d, l
	ld	e, c
	ld	l, h
	ld	h, a
	jr	c, 1$
	jp	m, round_pack
	jr	normalize
1$:	xor	a, a			; equal exponents, so E = 0: negate
	sub	a, d
	ld	d, a
	ld	a, #0
	sbc	a, l
	ld	l, a
	ld	a, #0
	sbc	a, h
	ld	h, a
	ex	af, af'
	ccf
	ex	af, af'

; HL:DE with any number of leading zeros, and A', CF': normalizes, rounds, packs.
; A difference of nothing is +0.
normalize:
	ld	c, #0			; places moved
	ld	a, h
	or	a, a
	jr	nz, 2$
	or	a, l
	or	a, d
	or	a, e
	jr	z, 6$
1$:	ld	h, l
	ld	l, d
	ld	d, e
	ld	e, #0
	ld	a, c
	add	a, #8
	ld	c, a
	ld	a, h
	or	a, a
	jr	z, 1$
2$:	jp	m, 4$			; sign of H
3$:	inc	c
	or	a, a
	rl	de
	adc	hl, hl
	jp	p, 3$
4$:	ex	af, af'
	ld	b, a
	ex	af, af'
	ld	a, b
	sub	a, c
	jr	c, 5$
	jr	z, 5$
	ld	b, a
	ex	af, af'
	ld	a, b
	ex	af, af'
	jp	round_pack
5$:	ld	c, a			; subnormal
	sbc	a, a
	ld	b, a
	jp	round_pack_wide
6$:	ld	de, #0
	ld	h, d
	ld	l, d
	ret

; Zero, subnormal, infinite or NaN: first both operands as they came.
add_special_b:
	swap
	sla	l
	ex	af, af'
	rr	hl
	ld	a, h
	xor	a, b
	add	a, a
	swap
	rr	hl
	swap
	jr	add_special
add_special_a:
	ld	a, b
	add	a, a
	rr	hl
add_special:
	ld	b, h			; B, C: their signs
	add	hl, hl
	inc	h
	jr	z, 4$
	dec	h
	swap
	ld	c, h
	add	hl, hl
	inc	h
	jr	z, 5$
	dec	h
	ld	a, h			; both finite: is b zero?
	or	a, l
	or	a, d
	or	a, e
	jr	z, 2$
	swap
	ld	a, h			; is a?
	or	a, l
	or	a, d
	or	a, e
	jr	z, 3$
	call	unpack_finite
	ld	a, b
	add	a, a
	ld	a, h
	ex	af, af'
	ld	a, b
	xor	a, c
	ld	b, a
	ld	c, h
	swap
	call	unpack_finite
	jp	add_unpacked
2$:	swap				; b = 0: a, but -0 only if both are
	ld	a, h
	or	a, l
	or	a, d
	or	a, e
	ld	a, b
	jr	nz, 21$
	and	a, c
21$:	add	a, a
	rr	hl
	ret
3$:	swap				; a = 0: b
	ld	a, c
	add	a, a
	rr	hl
	ret
4$:	ld	a, l			; a infinite or NaN
	or	a, d
	or	a, e
	jr	nz, 6$
	swap
	ld	a, h
	ld	c, b			; the result's sign if b is finite
	add	hl, hl
	inc	h
	jr	nz, 7$
	xor	a, b			; both infinite: of one sign?
	jp	m, nan
5$:	ld	a, l			; b infinite or NaN
	or	a, d
	or	a, e
	jr	z, 7$
6$:	jp	nan
7$:	ld	a, c
	add	a, a
	ex	af, af'
	jp	infinity

; The current operand, doubled and finite: unpacked, with exponent 1 if subnormal.
unpack_finite:
	srl	l
	ld	a, h
	or	a, a
	jr	z, 1$
	set	7, l
	ret
1$:	inc	h
	ret

; ---------------------------------------------------------------- multiply, unusual

; Special operands, or a result that may be subnormal or overflow. From ___fsmul, with
; a doubled, B = H of a; or with a.low in DE, a.high in DE', exponent of a in C, B = sign.
mul_special:
	ld	a, b
	take_second
	ld	b, a
	call	unpack_pair_raw
	jr	mul_pair
mul_wide:
	ex	de', hl
	bit	7, d
	jr	z, 1$
	dec	hl
1$:	ld	h, c
	sla	l
	ld	a, b
	take_second
	ld	b, a
	swap
	add	hl, hl
	call	unpack_pair
mul_pair:
	jr	nz, 4$
	push	hl
	ld	hl, iy
	add	hl, bc			; exponent if the product is below 2
	ld	bc, #-127
	add	hl, bc
	ex	(sp), hl
	ld	h, #0
	bit	7, d
	jr	z, 2$
	inc	hl
2$:	swap
	ld	h, #0
	bit	7, d
	jr	z, 3$
	inc	hl
3$:	ld	iy, hl			; the current one's high part
	ex	de, hl			; low part
	altd
	ex	de', hl
	altd
	ex	de, hl
	product
	pop	bc
	jr	finish_wide
4$:	cp	a, #INFINITE + ZERO
	jp	nc, nan			; infinity * 0, NaN
	cp	a, #ZERO
	jp	z, zero
	jp	infinity

; Rounds and packs with the exponent BC + A', A' being 0 or 1.
finish_wide:
	ex	af, af'
	dec	a			; keeps the carry
	jr	nz, 1$
	inc	bc
1$:	ex	af, af'
	jp	round_pack_wide

; Both operands by unpack_any, for products and quotients. Current a, other b; BC and
; IY = their exponents, CF' = sign, A' = 0; A = classes or-ed, Z if both are FINITE.
; Entered with current a doubled, other b as it came, B = H of a; ...
unpack_pair_raw:
	swap
	ld	a, h
	xor	a, b
	ld	b, a
	add	hl, hl
	jr	unpack_pair
; ... with current b and other a unpacked, B = sign; ...
unpack_pair_normal:
	sla	l
; ... with current b doubled, other a unpacked, B = sign; ...
unpack_pair_b:
	swap
	sla	l
	swap
; ... with both doubled, current b, B = sign.
unpack_pair:
	ld	a, b
	add	a, a
	ld	a, #0
	ex	af, af'
	call	unpack_any
	push	bc
	pop	iy
	swap
	call	unpack_any
	swap
	or	a, h
	swap
	ret

; ---------------------------------------------------------------- divide

; float ___fsdiv(float a, float b): a / b.
; Clocks: mean 1200, at most 1270. Stack: 4.
___fsdiv::
	take_second
	ld	b, h
	add	hl, hl
	unpack_normal	div_special_a
	ld	c, h
	swap
	ld	a, h
	xor	a, b
	ld	b, a			; bit 7: sign
	add	hl, hl
	unpack_normal	div_special_b
	cpl				; -(exponent of b)
	add	a, c			; carry: the difference is not negative
	jr	nc, 1$
	add	a, #125
	jr	c, div_wide		; overflow
	cp	a, #253
	jr	nc, div_wide		; may overflow
	jr	2$
1$:	sub	a, #131
	jr	c, div_wide		; may be subnormal
2$:	ld	c, a
	ld	a, b
	add	a, a
	ld	a, c
	inc	a			; exponent if the quotient is below 1
	ex	af, af'
	call	significand_quotient
	jp	round_pack

div_special_a:
	call	unpack_pair_raw
	jr	div_pair
div_special_b:
	call	unpack_pair_b
	jr	div_pair
div_wide:
	call	unpack_pair_normal
div_pair:
	jr	nz, 1$
	swap
	push	hl
	ld	h, b
	ld	l, c
	push	iy
	pop	bc
	or	a, a
	sbc	hl, bc			; exponent if the quotient is below 1
	ld	bc, #126
	add	hl, bc
	ex	(sp), hl
	call	significand_quotient
	pop	bc
	jp	finish_wide
1$:	and	a, #NAN
	jp	nz, nan
	ld	a, h
	swap
	cp	a, h
	jp	z, nan			; 0 / 0, infinity / infinity
	cp	a, #INFINITE
	jp	z, infinity
	cp	a, #ZERO
	jp	z, zero
	ld	a, h
	cp	a, #ZERO
	jp	z, infinity
	jp	zero

; Eight more bits of the quotient, complemented, in B; remainder A:HL below divisor C:DE.
	.macro	quotient_byte, ?bit, ?certain, ?fits, ?end
	ld	b, #1			; falls out after eight shifts
bit:
	add	hl, hl
	adc	a, a
	jr	c, certain
	sbc	hl, de
	sbc	a, c
	jr	nc, fits
	add	hl, de
	adc	a, c
fits:
	rl	b
	jr	nc, bit
	jr	end
certain:
	or	a, a
	sbc	hl, de
	sbc	a, c
	or	a, a
	rl	b
	jr	nc, bit
end:
	.endm

; Quotient of the other significand by the current one, top bits 1: HL:DE, sticky; A'
; is incremented if the quotient is 1 or more.
significand_quotient:
	ld	c, l
	ex	de', hl
	altd
	ex	de, hl
	ld	a, e
	altd
	ex	de, hl			; A:HL = dividend, then remainder; C:DE = divisor
	or	a, a
	sbc	hl, de			; the first bit is 1, of the dividend or its double
	sbc	a, c
	jr	c, 1$
	ex	af, af'
	inc	a
	ex	af, af'
	jr	2$
1$:	add	hl, de
	adc	a, c
	add	hl, hl
	adc	a, a
	or	a, a
	sbc	hl, de
	sbc	a, c
2$:	quotient_byte
	altd
	ld	h, b
	quotient_byte
	altd
	ld	l, b
	quotient_byte
	or	a, h
	or	a, l			; zero: no remainder
	altd
	ex	de, hl
	ld	a, d
	cpl
	ld	h, a
	ld	a, e
	cpl
	ld	l, a
	ld	a, b
	cpl
	ld	d, a
	ld	e, #0
	jr	z, 3$
	ld	e, #2			; sticky
3$:	scf				; the first bit
	rr	hl
	rr	de
	ret

; ---------------------------------------------------------------- square root

; float sqrtf(float x): the square root; NaN below 0, -0 for -0.
; Clocks: mean 1140, at most 1170. Stack: 6.
;
; The root of 25 bits is s * 2^12 + t. s, its 13 upper bits, comes digit by digit
; and leaves r; then t = r * 2^12 / 2s, one less where the remainder is below t^2.
_sqrtf::
	add	hl, hl
	jp	c, sqrt_negative
	unpack_normal	sqrt_special
	add	a, #128			; (exponent + 127) / 2, positive
	rra
	or	a, a
	ex	af, af'
	ld	c, h
sqrt_unpacked:
	ld	h, l			; radicand: the significand, halved if the exponent is odd
	ld	l, d
	ld	d, e
	ld	e, #0
	bit	0, c
	jr	z, 1$
	or	a, a
	rr	hl
	rr	de
1$:	push	de
	ex	de, hl
	ld	hl, #0
	ld	bc, #1
	ld	a, #8
	or	a, a
	call	root_digits
	pop	de
	ld	a, #5
	call	root_digits
	srl	b
	rr	c			; BC = 2s, HL = r
	push	bc
	or	a, a
	sbc	hl, bc
	jr	z, 5$			; r = 2s, its greatest: t is just below 2^12
	add	hl, bc
	ld	de, #0x0010		; falls out after twelve shifts
2$:	add	hl, hl
	sbc	hl, bc
	jr	nc, 3$
	add	hl, bc
3$:	rl	de
	jr	nc, 2$
	push	hl			; what is left, times 2^12
	ld	a, e
	cpl
	ld	l, a
	ld	a, d
	cpl
	and	a, #0x0f
	ld	h, a			; HL = t
	add	hl, hl
	add	hl, hl
	ld	b, h
	ld	c, l
	ex	de, hl			; DE = 4t
	mul				; HL:BC = 16 t^2
	ld	a, b
	or	a, c
	add	a, #0xff		; carry if BC is not 0
	ld	b, h
	ld	c, l
	pop	hl
	sbc	hl, bc
	jr	c, 4$
	inc	a
	or	a, h
	or	a, l			; zero: the root is exact
	jr	6$
4$:	dec	de			; between t - 1 and t: a quarter below t
	jr	6$
5$:	ld	de, #4 * 4096 - 1	; just below 4096
6$:	ex	de, hl
	add	hl, hl
	add	hl, hl
	ex	de, hl			; DE = 16 t
	pop	hl
	or	a, a
	rr	hl			; HL = s
	rl	de
	adc	hl, hl
	rl	de
	adc	hl, hl
	rl	de
	adc	hl, hl
	or	a, a
	jp	z, round_pack
	set	0, e
	jp	round_pack

; A more digits of a root: DE = radicand from its top bit, HL = remainder,
; BC = 4 * root + 1; all below 2^15, carry 0 before and after.
root_digits:
	rl	de
	adc	hl, hl
	rl	de
	adc	hl, hl
	sbc	hl, bc
	jr	nc, 1$
	add	hl, bc
	sla	c
	rl	b
	dec	bc
	dec	a
	jr	nz, root_digits
	ret
1$:	sla	c
	rl	b
	inc	bc
	inc	bc
	inc	bc
	dec	a
	jr	nz, root_digits
	ret

sqrt_special:
	or	a, a
sqrt_negative:
	ex	af, af'			; CF' = sign
	call	unpack_any
	or	a, a
	jr	nz, 1$
	ex	af, af'
	jp	c, nan
	ld	a, c
	add	a, #127
	srl	a
	or	a, a
	ex	af, af'
	jp	sqrt_unpacked
1$:	cp	a, #ZERO
	jp	z, zero
	cp	a, #NAN
	jp	z, nan
	ex	af, af'
	jp	c, nan
	ex	af, af'
	jp	infinity

; ---------------------------------------------------------------- compare

; bool ___fslt(float a, float b): 1 if a < b, else 0; 0 with a NaN, -0 equals +0.
; SDCC makes a <= b of !(b < a): with a NaN that is true, which no runtime can mend.
; Clocks: mean 110, at most 120. Stack: 2.
___fslt::
	pop	iy
	ex	de, hl
	ex	de', hl
	pop	bc
	pop	hl			; DE:DE' = a, HL:BC = b
	ld	a, d
	or	a, #0x80
	inc	a
	jr	z, 3$
1$:	ld	a, h
	or	a, #0x80
	inc	a
	jr	z, 4$
2$:	ld	a, d
	xor	a, h
	jp	m, 6$
	ld	a, h
	add	a, a			; carry: both are negative, and |a| <= |b| is sought
	ex	de', hl
	sbc	hl, bc
	ex	de', hl
	ex	de, hl
	sbc	hl, de
	sbc	a, a
	xor	a, d
	rlca
	and	a, #1
	jp	(iy)
3$:	ld	a, e			; is a a NaN?
	add	a, a
	jr	nc, 1$
	jr	nz, 5$
	ex	de', hl
	ld	a, h
	or	a, l
	ex	de', hl
	jr	z, 1$
	jr	5$
4$:	ld	a, l			; is b?
	add	a, a
	jr	nc, 2$
	or	a, b
	or	a, c
	jr	z, 2$
5$:	xor	a, a
	jp	(iy)
6$:	bit	7, d			; signs differ: a < b if a < 0, but for zeros
	jr	z, 5$
	ld	a, d
	add	a, a
	or	a, e
	or	a, h
	or	a, l
	or	a, b
	or	a, c
	ex	de', hl
	or	a, h
	or	a, l
	jr	z, 5$
	ld	a, #1
	jp	(iy)

; bool ___fseq(float a, float b): 1 if a == b, else 0; 0 with a NaN, -0 equals +0.
; Clocks: 50, for equal bits up to 100. Stack: 2.
___fseq::
	pop	iy
	ex	de, hl
	pop	bc
	or	a, a
	sbc	hl, bc
	ex	de, hl
	pop	de			; HL = upper word of a, DE:BC = b
	jr	nz, 3$
	sbc	hl, de
	jr	nz, 1$
	ld	a, d			; the same bits: equal unless NaN
	or	a, #0x80
	inc	a
	jr	nz, 2$
	ld	a, e
	add	a, a
	jr	nc, 2$
	or	a, b
	or	a, c
	jr	z, 2$
	xor	a, a
	jp	(iy)
1$:	ld	a, h			; upper words differ: equal if both are zero
	xor	a, #0x80
	or	a, l
	or	a, e
	or	a, b
	or	a, c
	jr	nz, 3$
	ld	a, d
	add	a, a
	jr	nz, 3$
2$:	ld	a, #1
	jp	(iy)
3$:	xor	a, a
	jp	(iy)

; ---------------------------------------------------------------- from integers

; float ___slong2fs(long x), and the others by their names: nearest float.
; Clocks: long mean 240, at most 340; int 210, 330; char 170, 270. Stack: 4.
___schar2fs::
	ld	h, a
	ld	l, #0
	ld	b, #127 + 7
	jr	from_signed_word
___sint2fs::
	ld	b, #127 + 15
from_signed_word:
	ld	de, #0
	jr	from_signed
___slong2fs::
	ld	b, #127 + 31
from_signed:
	ld	a, h
	add	a, a
	ld	a, b
	ex	af, af'
	bit	7, h
	jp	z, normalize
	call	negate
	jp	normalize
___uchar2fs::
	ld	h, a
	ld	l, #0
	ld	b, #127 + 7
	jr	from_unsigned_word
___uint2fs::
	ld	b, #127 + 15
from_unsigned_word:
	ld	de, #0
	jr	from_unsigned
___ulong2fs::
	ld	b, #127 + 31
from_unsigned:
	ld	a, b
	or	a, a
	ex	af, af'
	jp	normalize

; HL:DE = -HL:DE.
negate:
	xor	a, a
	sub	a, e
	ld	e, a
	ld	a, #0
	sbc	a, d
	ld	d, a
	ld	a, #0
	sbc	a, l
	ld	l, a
	ld	a, #0
	sbc	a, h
	ld	h, a
	ret

; ---------------------------------------------------------------- to integers

; long ___fs2slong(float x): towards zero. Out of range, infinite or NaN (undefined in
; C): 0x80000000, as cvttss2si gives. The narrower ones are its low bits, as gcc's are.
; Clocks: mean 130, at most 260, narrower ones 10 more. Stack: 2, narrower ones 4.
___fs2slong::
	ld	a, #31
	jr	truncate

; unsigned long ___fs2ulong(float x): towards zero, modulo 2^32 above -2^32;
; elsewhere 0x80000000.
___fs2ulong::
	ld	a, #32
truncate:
	ld	b, h
	add	hl, hl
	ld	c, a
	ld	a, h
	scf
	rr	l
	sub	a, #127
	jr	c, 5$			; below 1
	cp	a, c
	jr	nc, 6$
	ld	h, l
	ld	l, d
	ld	d, e
	ld	e, #0
	cpl
	add	a, #32			; 31 - exponent places to the right
	cp	a, #16
	jr	c, 1$
	sub	a, #16
	ex	de, hl
	ld	hl, #0
1$:	cp	a, #8
	jr	c, 2$
	sub	a, #8
	ld	e, d
	ld	d, l
	ld	l, h
	ld	h, #0
2$:	ld	c, b
	or	a, a
	jr	z, 4$
	ld	b, a
3$:	or	a, a
	rr	hl
	rr	de
	djnz	3$
4$:	bit	7, c
	jr	nz, negate
	ret
5$:	ld	hl, #0
	ld	de, #0
	ret
6$:	ld	hl, #0x8000
	ld	de, #0
	ret

___fs2sint::
___fs2uint::
	call	___fs2slong
	ex	de, hl
	ret
___fs2schar::
___fs2uchar::
	call	___fs2slong
	ld	a, e
	ret

; ---------------------------------------------------------------- floor, magnitude

; float fabsf(float x): the sign removed, of a NaN too. Clocks: 24. Stack: 2.
_fabsf::
	res	7, h
	ret

; float floorf(float x): the greatest integer not above x.
; Clocks: mean 140, at most 280. Stack: 4.
_floorf::
	ld	b, h
	ld	c, l
	add	hl, hl
	ld	a, h
	ld	h, b
	ld	l, c
	sub	a, #127
	jr	c, 5$			; below 1
	cp	a, #23
	jr	nc, 7$			; whole
	cpl
	add	a, #24			; A = fraction bits, 1 to 23; their mask in A, B, C
	cp	a, #8
	jr	c, 1$
	cp	a, #16
	jr	c, 2$
	sub	a, #16
	call	low_ones
	ld	bc, #0xffff
	jr	3$
1$:	call	low_ones
	ld	c, a
	xor	a, a
	ld	b, a
	jr	3$
2$:	sub	a, #8
	call	low_ones
	ld	b, a
	xor	a, a
	ld	c, #0xff
3$:	bit	7, h
	jr	z, 4$
	ex	de, hl			; negative: a fraction carries into the whole part
	add	hl, bc
	ex	de, hl
	push	af
	pop	iy
	adc	a, l
	ld	l, a
	jr	nc, 31$
	inc	h
31$:	push	iy
	pop	af
4$:	cpl
	and	a, l
	ld	l, a
	ld	a, b
	cpl
	and	a, d
	ld	d, a
	ld	a, c
	cpl
	and	a, e
	ld	e, a
	ret
5$:	ld	a, h
	add	a, a
	jr	nc, 6$
	or	a, l
	or	a, d
	or	a, e
	jr	z, 8$			; -0
	ld	hl, #0xbf80
	ld	de, #0
	ret
6$:	ld	hl, #0
	ld	de, #0
	ret
7$:	cp	a, #128
	jr	nz, 8$
	ld	a, l			; a NaN becomes quiet
	add	a, a
	or	a, d
	or	a, e
	jr	z, 8$
	set	6, l
8$:	ret

; A = 2^A - 1, for 0 to 7; B is lost.
low_ones:
	ld	b, a
	xor	a, a
	inc	b
	jr	2$
1$:	scf
	rla
2$:	djnz	1$
	ret
