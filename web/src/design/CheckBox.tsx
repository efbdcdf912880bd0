interface CheckBoxProps {
  readonly checked: boolean;
  readonly disabled?: boolean;
  readonly testId?: string;
  readonly onChange: (checked: boolean) => void;
}

/** A box to tick, from the keyboard by Enter: the space bar means HOLD everywhere. */
export function CheckBox({ checked, disabled, testId, onChange }: CheckBoxProps) {
  return (
    <input
      type="checkbox"
      checked={checked}
      disabled={disabled}
      data-testid={testId}
      onChange={(event) => {
        onChange(event.target.checked);
      }}
      onKeyDown={(event) => {
        if (event.key !== "Enter") return;
        event.preventDefault(); // It would send a form.
        if (!event.repeat) onChange(!checked);
      }}
    />
  );
}
