import { useRef, useState } from "react";
import { Icon } from "../design/Icon";
import { words } from "../text/words";

/** Lines for a file, to be copied or downloaded. */
export function TomlSnippet({ toml, name }: { readonly toml: string; readonly name: string }) {
  const text = words.setup.calibrating;
  const lines = useRef<HTMLTextAreaElement>(null);
  const [copied, setCopied] = useState(false);
  const copy = async () => {
    lines.current?.select();
    try {
      await navigator.clipboard.writeText(toml);
      setCopied(true);
    } catch {
      // No clipboard by plain http: the lines are selected, which is as near as it gets.
    }
  };
  return (
    <div className="snippet">
      <label>
        {text.snippet}
        <textarea ref={lines} readOnly rows={toml.trimEnd().split("\n").length} value={toml} data-testid="snippet" />
      </label>
      <div className="calibration-buttons">
        <button
          type="button"
          className="button button-small"
          onClick={() => {
            void copy();
          }}
        >
          <Icon name={copied ? "check" : "draw"} />
          {copied ? text.copied : text.copy}
        </button>
        <a
          className="button button-small"
          href={`data:application/toml;charset=utf-8,${encodeURIComponent(toml)}`}
          download={name}
        >
          <Icon name="download" />
          {text.download}
        </a>
      </div>
    </div>
  );
}
