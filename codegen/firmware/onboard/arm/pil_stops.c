/* pil_stops: the two empty functions where the harness stops a simulated processor */
void pil_wait(void);
void pil_done(void);

void pil_wait(void)
{
}

void pil_done(void)
{
}
