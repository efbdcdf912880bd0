import { useId, useState, type ReactNode, type SubmitEvent } from "react";
import type { CaptureRequest, Mode } from "../api/captures";
import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import { words } from "../text/words";
import { FIRST_WISH, LIMITS, requestFromWish, wishErrors, type Wish } from "./wish";

const MODES: readonly Mode[] = ["optimized", "standard"];

interface CaptureFormProps {
  readonly onPrepare: (request: CaptureRequest) => void;
}

/** What to capture next, and the button that leads to its checklist. */
export function CaptureForm({ onPrepare }: CaptureFormProps) {
  const droneCount = useConsole((state) => state.drones.size);
  const [wish, setWish] = useState<Wish>(FIRST_WISH);
  const errors = wishErrors(wish);
  const valid = Object.keys(errors).length === 0;
  const text = words.mission.form;
  const change = (part: Partial<Wish>) => {
    setWish({ ...wish, ...part });
  };
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    if (valid) onPrepare(requestFromWish(wish));
  };
  return (
    <form className="capture-form" noValidate onSubmit={submit} aria-label={text.title}>
      <fieldset className="choice">
        <legend>{text.mode}</legend>
        {MODES.map((mode) => (
          <label key={mode}>
            <input
              type="radio"
              name="mode"
              value={mode}
              checked={wish.mode === mode}
              onChange={() => {
                change({ mode });
              }}
            />
            <span>{words.mission.mode[mode]}</span>
          </label>
        ))}
      </fieldset>
      <p className="hint">{words.mission.modeDoes[wish.mode]}</p>
      <div className="form-row">
        <Field label={text.pictures} error={errors.pictures}>
          {(props) => (
            <input
              {...props}
              type="number"
              inputMode="numeric"
              min={LIMITS.pictures.least}
              max={LIMITS.pictures.most}
              value={wish.pictures}
              onChange={(event) => {
                change({ pictures: event.target.value });
              }}
            />
          )}
        </Field>
        <Field label={text.trainSeconds} error={errors.trainSeconds}>
          {(props) => (
            <input
              {...props}
              type="number"
              inputMode="decimal"
              min={0}
              max={LIMITS.trainSeconds.most}
              value={wish.trainSeconds}
              onChange={(event) => {
                change({ trainSeconds: event.target.value });
              }}
            />
          )}
        </Field>
        <Field label={text.drones} error={undefined}>
          {(props) => (
            <select
              {...props}
              value={wish.drones}
              onChange={(event) => {
                change({ drones: event.target.value });
              }}
            >
              <option value="">{text.allDrones}</option>
              {Array.from({ length: droneCount }, (_, index) => (
                <option key={index} value={index + 1}>
                  {index + 1}
                </option>
              ))}
            </select>
          )}
        </Field>
      </div>
      <Field label={text.name} error={errors.name}>
        {(props) => (
          <input
            {...props}
            type="text"
            autoComplete="off"
            spellCheck={false}
            placeholder={text.namePlaceholder}
            value={wish.name}
            onChange={(event) => {
              change({ name: event.target.value });
            }}
          />
        )}
      </Field>
      <button
        type="submit"
        className="button button-primary button-wide"
        data-testid="capture-start"
        disabled={!valid}
      >
        <Icon name="play" />
        {text.start}
        <small>{text.takesOff}</small>
      </button>
    </form>
  );
}

interface FieldProps {
  readonly label: string;
  readonly error: string | undefined;
  readonly children: (props: {
    id: string;
    "aria-invalid": boolean;
    "aria-describedby": string | undefined;
  }) => ReactNode;
}

/** A labelled input with its error below it, tied together for screen readers. */
function Field({ label, error, children }: FieldProps) {
  const id = useId();
  const bad = error !== undefined;
  return (
    <div className={`field-input ${bad ? "is-bad" : ""}`}>
      <label htmlFor={id}>{label}</label>
      {children({ id, "aria-invalid": bad, "aria-describedby": bad ? `${id}-error` : undefined })}
      {bad && (
        <span className="field-error" id={`${id}-error`}>
          {error}
        </span>
      )}
    </div>
  );
}
