<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Ground that a session worked in a field. -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips|Temporal" labelsEnabled="0">
 <temporal enabled="1" mode="1" startField="date" endField="" startExpression="" endExpression="" durationField="" durationUnit="ms" fixedDuration="0" limitMode="0" accumulate="1">
  <fixedRange>
   <start></start>
   <end></end>
  </fixedRange>
 </temporal>
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="120,160,200,120"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="60,80,110,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.2"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <mapTip enabled="1">&lt;b&gt;[% &quot;name&quot; %]&lt;/b&gt;, [% format_date(&quot;date&quot;, 'yyyy-MM-dd') %], [% &quot;machine&quot; %]&lt;br&gt;[% coalesce(format_number(&quot;worked_area_m2&quot;, 0), '?') %] m² worked, [% coalesce(format_number(&quot;overlap_area_m2&quot;, 0), '?') %] m² twice, [% coalesce(format_number(&quot;missed_area_m2&quot;, 0), '?') %] m² missed&lt;br&gt;[% coalesce(format_number(&quot;hours&quot;, 1), '?') %] h, [% coalesce(format_number(&quot;work_rate_ha_h&quot;, 2), '?') %] ha/h, [% coalesce(format_number(&quot;soil_moved_m3&quot;, 1), '?') %] m³ moved</mapTip>
</qgis>
