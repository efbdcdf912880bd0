interface NumberFieldProps {
  readonly id: string;
  readonly label: string;
  readonly value: string;
  readonly min: number;
  readonly max: number;
  /** Whole numbers only; else any. */
  readonly whole?: boolean;
  readonly valid: boolean;
  /** Id of the text that says what is wanted. */
  readonly describedBy?: string;
  readonly onChange: (value: string) => void;
}

/** A number with its label, as a form's row has them: what is typed is kept as typed. */
export function NumberField({ id, label, value, min, max, whole, valid, describedBy, onChange }: NumberFieldProps) {
  return (
    <>
      <label htmlFor={id}>{label}</label>
      <input
        id={id}
        type="number"
        inputMode={whole === true ? "numeric" : "decimal"}
        step={whole === true ? 1 : "any"}
        min={min}
        max={max}
        value={value}
        aria-invalid={!valid}
        aria-describedby={describedBy}
        onChange={(event) => {
          onChange(event.target.value);
        }}
      />
    </>
  );
}
